"""What robots on a ROS 2 network have in common: stamps, poses, transforms and commands."""
