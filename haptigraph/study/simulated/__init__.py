"""Simulated participants, and the simulation of a whole study with them."""
