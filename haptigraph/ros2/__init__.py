"""ROS 2 without a ROS installation: its messages and names over plain DDS."""

from haptigraph.errors import MissingExtra

try:
    import cyclonedds as cyclonedds
except ImportError:
    raise MissingExtra("ros2", "ros") from None
