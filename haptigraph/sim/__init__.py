"""The simulator: eye, robot, operator, camera of a phantom. Never imports perception, scene or inference."""
