"""The file that describes a robot's place and limits: robot.toml.

It is written by `haptigraph robot calibrate`, and edited by hand. Without it no robot moves.
"""

from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from msgspec import Meta, Struct

from haptigraph.robot.pose import Quaternion, ToolPose, Transform, Vec3
from haptigraph.toml_document import Document

__all__ = [
    "EyePlace",
    "MotionLimits",
    "RcmPlace",
    "RobotSetup",
    "ShaftAxis",
    "direction_of_axis",
    "load_setup",
    "parse_setup",
]

ShaftAxis = Literal["+x", "-x", "+y", "-y", "+z", "-z"]
Millimetres = Annotated[float, Meta(ge=-10_000, le=10_000)]
Point = tuple[Millimetres, Millimetres, Millimetres]
UNIT_TOLERANCE = 1e-3


class MotionLimits(Struct, frozen=True, forbid_unknown_fields=True):
    """Limits of commanded motion."""

    depth_min_mm: Annotated[float, Meta(ge=-100, le=100)] = -12.0
    """From the RCM to the tip, along the shaft; negative outside the eye."""
    depth_max_mm: Annotated[float, Meta(ge=0, le=100)] = 24.0
    tilt_max_deg: Annotated[float, Meta(gt=0, le=90)] = 50.0
    """Of the shaft, from the line RCM -> centre of the eye."""
    speed_mm_s: Annotated[float, Meta(gt=0, le=100)] = 10.0
    """Of the tip."""
    turn_deg_s: Annotated[float, Meta(gt=0, le=360)] = 30.0
    force_n: Annotated[float, Meta(gt=0, le=50)] | None = None
    """Measured force at which the robot is held; unset: force is not supervised."""
    rcm_tolerance_mm: Annotated[float, Meta(gt=0, le=5)] = 0.1
    """Largest distance of the commanded shaft from the RCM; a command beyond it is refused."""
    measured_rcm_tolerance_mm: Annotated[float, Meta(gt=0, le=10)] = 0.5
    """Largest distance of the measured shaft from the RCM; beyond it the robot is held."""
    stale_ms: Annotated[float, Meta(gt=0, le=1000)] = 40.0
    """Age of a measured pose at which the robot is held."""
    deadman_ms: Annotated[float, Meta(gt=0, le=250)] = 100.0
    """Time without a message of the leader after which the robot is held."""


class RcmPlace(Struct, frozen=True, forbid_unknown_fields=True):
    """The remote centre of motion: where the trocar is."""

    at_mm: Point
    """In the robot's base."""
    sd_mm: Annotated[float, Meta(ge=0, le=10)] | None = None
    """Standard deviation per axis; unset: unknown."""


class EyePlace(Struct, frozen=True, forbid_unknown_fields=True):
    """Where the eye frame is in the robot's base."""

    translation_mm: Point
    """The globe's centre."""
    quaternion: Quaternion
    """Rotation from the eye frame to the robot's base: x, y, z, w."""
    residual_rms_mm: Annotated[float, Meta(ge=0)] | None = None
    """Of the calibration; unset: unknown."""
    tip_sd_mm: Annotated[float, Meta(ge=0)] | None = None
    """Standard deviation, per axis, of the robot's tip in the eye frame; unset: unknown."""

    def __post_init__(self) -> None:
        if abs(np.linalg.norm(self.quaternion) - 1.0) > UNIT_TOLERANCE:
            raise ValueError(f"quaternion must have length 1, found {list(self.quaternion)}")

    @property
    def robot_from_eye(self) -> Transform:
        """The transform from the eye frame to the robot's base."""
        return Transform.of(ToolPose(self.translation_mm, self.quaternion))


class RobotSetup(Struct, frozen=True, forbid_unknown_fields=True):
    """The contents of robot.toml."""

    rcm: RcmPlace
    format: Literal[1] = 1
    shaft_axis: ShaftAxis = "+z"
    """Axis of the tool's frame that points along the shaft, from handle to tip."""
    eye: EyePlace | None = None
    """Unset: not calibrated."""
    limits: MotionLimits = MotionLimits()

    @property
    def shaft_axis_tool(self) -> Vec3:
        """The shaft's direction in the tool's frame, length 1."""
        return direction_of_axis(self.shaft_axis)


def direction_of_axis(axis: ShaftAxis) -> Vec3:
    """Return the direction of an axis in its frame, length 1."""
    sign = 1.0 if axis[0] == "+" else -1.0
    x, y, z = (sign * (name == axis[1]) for name in "xyz")
    return x, y, z


def load_setup(path: str | Path) -> RobotSetup:
    """Read robot.toml.

    Raises:
        BadInput: If it cannot be read or is not valid.
    """
    return Document.read(path).convert(RobotSetup)


def parse_setup(text: str, file: str) -> RobotSetup:
    """Read it from text; `file` names it in errors."""
    return Document(text, file).convert(RobotSetup)
