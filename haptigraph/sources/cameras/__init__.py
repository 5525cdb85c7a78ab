"""Live sources (UVC and network cameras, RealSense, ROS 2 topics) and RealSense recordings."""
