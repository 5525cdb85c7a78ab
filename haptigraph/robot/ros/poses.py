"""Convert poses between ROS messages (m; x, y, z, w) and millimetres, and refuse what is no pose."""

import math

from haptigraph.robot.pose import ToolPose, Vec3
from haptigraph.ros2.geometry_types import Pose, Quaternion, Vector3
from haptigraph.ros2.types import Point

__all__ = ["MAX_REACH_MM", "as_message", "finite_vector", "tool_pose"]

MAX_REACH_MM = 10_000.0
"""Position of a robot's tool at most; a larger one is not in metres."""


def tool_pose(position: Point | Vector3, orientation: Quaternion) -> ToolPose:
    """Convert a position [m] and an orientation.

    Raises:
        ValueError: If a number is not finite, the quaternion is not of unit length, or the position is not
            plausible.
    """
    at_m = (position.x, position.y, position.z)
    quaternion = (orientation.x, orientation.y, orientation.z, orientation.w)
    if not all(map(math.isfinite, (*at_m, *quaternion))):
        raise ValueError("a pose that is not finite")
    x_mm, y_mm, z_mm = (1e3 * length_m for length_m in at_m)
    pose = ToolPose((x_mm, y_mm, z_mm), quaternion)
    if not pose.is_finite:
        raise ValueError(f"a quaternion of length {math.hypot(*quaternion):.4g}, not 1")
    if max(map(abs, pose.position_mm)) > MAX_REACH_MM:
        raise ValueError(f"a tool {math.hypot(*at_m):.4g} m from the base; positions must be in metres")
    return pose


def as_message(pose: ToolPose) -> Pose:
    """Convert a pose to geometry_msgs/Pose."""
    x_m, y_m, z_m = (length_mm / 1e3 for length_mm in pose.position_mm)
    return Pose(Point(x_m, y_m, z_m), Quaternion(*pose.quaternion))


def finite_vector(vector: Vector3, what: str) -> Vec3:
    """Return the components of a vector.

    Raises:
        ValueError: If one is not finite; `what` names the vector.
    """
    if not all(map(math.isfinite, (vector.x, vector.y, vector.z))):
        raise ValueError(f"{what} that is not finite")
    return vector.x, vector.y, vector.z
