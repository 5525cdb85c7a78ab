"""Publish a run live to other systems, without ever delaying the loop."""
