"""Verification of procedures: claims proved over every possible graph, and the changes nearest to a graph."""
