"""Teleoperation: the motion of a hand becomes the motion of the simulated robot."""
