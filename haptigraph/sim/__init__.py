"""The simulator: eye, robot, operator and camera. It never imports perception, scene or inference."""
