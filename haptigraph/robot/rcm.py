"""The remote centre of motion in three dimensions: poses whose shaft passes through the trocar.

A pose of the instrument is a depth and a direction; its rotation about the shaft follows without spin.
"""

import math

import numpy as np

from haptigraph.robot.pose import Floats, Quaternion, ToolPose, Vec3, composed, rotated

__all__ = ["Rcm", "direction_of", "minimal_rotation", "turned"]


class Rcm:
    """A remote centre of motion, in the frame of the poses.

    Args:
        at_mm: The centre.
        shaft_axis: Direction of the shaft in the tool's frame, from handle to tip, length 1.
    """

    def __init__(self, at_mm: Vec3, shaft_axis: Vec3) -> None:
        self.at_mm = np.array(at_mm, dtype=np.float64)
        self._shaft_axis = shaft_axis

    def direction(self, pose: ToolPose) -> Floats:
        """Return the direction of the shaft, from handle to tip, (3,)."""
        return pose.axis(self._shaft_axis)

    def depth_mm(self, pose: ToolPose) -> float:
        """Return how far the tip is beyond the centre along the shaft; negative before it."""
        return float((np.array(pose.position_mm) - self.at_mm) @ self.direction(pose))

    def offset_mm(self, pose: ToolPose) -> Floats:
        """Return the vector from the centre to the nearest point of the shaft's line, (3,).

        The line is infinite, so it is defined wherever the tip is, also at the centre.
        """
        from_centre_mm, along = np.array(pose.position_mm) - self.at_mm, self.direction(pose)
        offset_mm: Floats = from_centre_mm - (from_centre_mm @ along) * along
        return offset_mm

    def distance_mm(self, pose: ToolPose) -> float:
        """Return the distance of the shaft's line from the centre."""
        return math.hypot(*self.offset_mm(pose).tolist())

    def pose(self, depth_mm: float, direction: Floats, near: ToolPose) -> ToolPose:
        """Return the pose whose shaft passes through the centre, with the smallest rotation from another.

        Args:
            depth_mm: From the centre to the tip.
            direction: Of the shaft, (3,), any length but 0.
            near: Its rotation about the shaft is kept.
        """
        turn = minimal_rotation(self.direction(near), direction)
        quaternion = composed(turn, near.quaternion)
        # The tip follows from the quaternion, not from the direction: so the shaft passes exactly.
        along = rotated(quaternion, self._shaft_axis)
        x, y, z = (at_mm + depth_mm * step for at_mm, step in zip(self.at_mm.tolist(), along, strict=True))
        return ToolPose((x, y, z), quaternion)


def minimal_rotation(before: Floats, after: Floats) -> Quaternion:
    """Return the smallest rotation that takes one direction to another.

    Of opposite directions, for which many are equally small, one is chosen.
    """
    a, b = _unit(before), _unit(after)
    cosine = float(a @ b)
    if cosine < -1 + 1e-12:
        least = np.eye(3)[int(np.abs(a).argmin())]
        x, y, z = _unit(_cross(a, least)).tolist()
        return x, y, z, 0.0
    x, y, z = _cross(a, b).tolist()
    length = math.hypot(x, y, z, 1 + cosine)
    return x / length, y / length, z / length, (1 + cosine) / length


def turned(direction: Floats, towards: Floats, angle_rad: float) -> Floats:
    """Turn a direction by an angle towards another that is perpendicular to it; both of length 1."""
    return _unit(math.cos(angle_rad) * direction + math.sin(angle_rad) * towards)


def direction_of(pitch_deg: float, elevation_deg: float) -> Floats:
    """Return a direction in the eye frame by two angles, (3,).

    Args:
        pitch_deg: In the section, from -y (down into the eye), counter-clockwise: positive to +x.
        elevation_deg: Out of the section, towards +z.
    """
    pitch, elevation = math.radians(pitch_deg), math.radians(elevation_deg)
    flat = math.cos(elevation)
    return np.array([flat * math.sin(pitch), -flat * math.cos(pitch), math.sin(elevation)])


def _unit(vector: Floats) -> Floats:
    return np.asarray(vector / math.hypot(*vector.tolist()))


def _cross(a: Floats, b: Floats) -> Floats:
    """Return the cross product; NumPy's takes ten times as long for single vectors."""
    (ax, ay, az), (bx, by, bz) = a.tolist(), b.tolist()
    return np.array([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx])
