"""Check where the tool is against robot.toml: the remote centre of motion, the shaft's axis, the eye."""

from collections.abc import Iterator

import numpy as np
from scipy.spatial.transform import Rotation

from haptigraph.findings import Finding
from haptigraph.robot.checking.recorded import Recorded
from haptigraph.robot.pose import Floats
from haptigraph.robot.setup import RobotSetup

__all__ = ["place_findings", "place_measurements"]

MAX_AWAY_MM = 300.0
"""From the RCM to the tip: a robot that is about to be steered stands by the eye."""


def place_findings(recorded: Recorded, setup: RobotSetup) -> Iterator[Finding]:
    """Yield the contradictions between poses and robot.toml.

    Args:
        recorded: With poses that are finite and in metres.
        setup: The robot's.
    """
    from_rcm_mm, axis = _shaft(recorded, setup)
    away_mm = np.linalg.norm(from_rcm_mm, axis=1)
    if (nearest_mm := float(away_mm.min())) > MAX_AWAY_MM:
        yield Finding(
            "rcm_far",
            f"the tip came no nearer to the RCM of robot.toml than {nearest_mm:.0f} mm; at most "
            f"{MAX_AWAY_MM:g} mm is valid: another base frame, other units, or a robot that stands "
            "elsewhere?",
        )
        return
    nearest = int(away_mm.argmin())
    depth_mm = float(from_rcm_mm[nearest] @ axis[nearest])
    tilt_deg = None
    if setup.eye is not None:
        to_eye_mm = np.array(setup.eye.translation_mm) - np.array(setup.rcm.at_mm)
        cosines = axis @ to_eye_mm / np.linalg.norm(to_eye_mm)
        tilt_deg = float(np.degrees(np.arccos(np.clip(cosines, -1, 1))).min())
    if depth_mm > setup.limits.depth_max_mm or (tilt_deg is not None and tilt_deg > 90):
        found = (
            f"{tilt_deg:.0f} deg from the direction to the eye" if tilt_deg is not None else "away from it"
        )
        yield Finding(
            "axis_opposite",
            f"the shaft at the RCM points {found}, with shaft_axis {setup.shaft_axis!r}; from handle to tip, "
            "into the eye, is valid: is the axis the opposite one?",
        )
    if setup.limits.force_n is not None and not len(recorded.wrenches):
        yield Finding(
            "force_missing",
            "limits.force_n is set, but no message came on measured_cf; measure forces, or remove the limit",
        )


def place_measurements(recorded: Recorded, setup: RobotSetup) -> dict[str, float]:
    """Return the smallest distances of tip and shaft to the RCM."""
    from_rcm_mm, axis = _shaft(recorded, setup)
    along_mm = (from_rcm_mm * axis).sum(axis=1)[:, None]
    return {
        "tip_to_rcm_mm": float(np.linalg.norm(from_rcm_mm, axis=1).min()),
        "shaft_to_rcm_mm": float(np.linalg.norm(from_rcm_mm - along_mm * axis, axis=1).min()),
    }


def _shaft(recorded: Recorded, setup: RobotSetup) -> tuple[Floats, Floats]:
    """Return the tip from the RCM [mm] (n, 3), and the shaft's direction (n, 3)."""
    numbers = recorded.poses.samples().numbers
    from_rcm_mm = 1e3 * numbers[:, :3] - np.array(setup.rcm.at_mm)
    axis: Floats = Rotation.from_quat(numbers[:, 3:]).apply(setup.shaft_axis_tool)
    return from_rcm_mm, axis
