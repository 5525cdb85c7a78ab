"""Simulated participants, and the rehearsal of a whole study with them."""
