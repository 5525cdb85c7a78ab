"""Measures of runs and trials, from steps or recordings."""
