"""Perception in B-scans: retinal surfaces and the needle, by image processing or by a network."""
