"""Figures of a study report."""
