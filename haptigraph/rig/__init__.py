"""A rig: printed eye, mirror and camera as designed; what its images must look like."""
