"""From relations to the surgical state: procedures, rule engine, explanations."""
