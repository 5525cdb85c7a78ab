"""Consumers of steps: recorder and console."""
