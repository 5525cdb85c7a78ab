"""Perception of the second operation: forceps, a second instrument and stained tissue."""
