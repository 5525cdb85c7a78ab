"""Live images: UVC and network cameras, RealSense, ROS 2 topics."""
