"""Procedures that ship with haptigraph: data, not code."""
