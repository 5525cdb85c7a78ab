"""Evidence for a safety case: hazards, what is claimed about each, and what supports every claim."""
