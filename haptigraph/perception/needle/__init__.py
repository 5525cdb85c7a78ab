"""The needle tracker, one stage per module; `tracker` runs them in order."""
