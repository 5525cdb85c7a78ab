"""Perception in OCT volumes: surfaces, needle, and where the tip will be at the moment of output."""
