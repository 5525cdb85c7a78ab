"""From relations to the surgical state: procedures and the rule engine."""
