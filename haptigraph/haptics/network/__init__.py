"""Actuators behind a ROS 2 network."""
