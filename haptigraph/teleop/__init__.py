"""Teleoperation: operator input becomes motion of the simulated robot."""
