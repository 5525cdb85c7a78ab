"""Turn the motion of a hand into motion of the simulated robot, image by image, about its RCM."""

import math

from haptigraph.geometry import subtract
from haptigraph.sim.robot.operator import Tremor
from haptigraph.sim.robot.robot import Pose, Robot
from haptigraph.teleop.band_stop import TREMOR_HZ
from haptigraph.teleop.mapping import HandMapping, ToolMotion, rotation_rad
from haptigraph.teleop.motion import TeleopSettings

__all__ = ["Teleop"]


class Teleop(HandMapping):
    """A hand as the operator of the phantom. Any thread may call `put`; the phantom's thread calls `move`.

    Args:
        rate_hz: Images per second of the phantom; the hand moves the robot once per image.
        settings: The initial settings.
        seed: Seed of the added tremor.
        has_jaws: Whether the tool is forceps, which the hand opens and closes.

    Raises:
        ValueError: If the rate is too low for the tremor filter.
    """

    duration_s = math.inf

    def __init__(
        self, rate_hz: float, settings: TeleopSettings | None = None, seed: int = 0, *, has_jaws: bool = False
    ) -> None:
        super().__init__(rate_hz, settings, has_jaws=has_jaws)
        self._tremor = Tremor(1.0, *TREMOR_HZ, seed)

    def move(self, robot: Robot, time_s: float, elapsed_s: float) -> None:
        """Move the robot by the displacement of the hand during one image."""
        tremor_mm, added_mm = (0.0, 0.0), self.settings.added_tremor_mm
        if added_mm:
            along, across = subtract(self._tremor.at(time_s), self._tremor.at(time_s - elapsed_s))
            tremor_mm = added_mm * along, added_mm * across
        motion = self.take(elapsed_s, tremor_mm)
        if motion is not None:
            robot.follow(_moved(robot.pose, motion), elapsed_s)

    def is_away(self, time_s: float) -> bool:
        """Return False: a hand removes the needle from the image only along its shaft."""
        return False


def _moved(pose: Pose, motion: ToolMotion) -> Pose:
    """Return the pose after a motion of tip and jaws; motion across becomes a rotation about the RCM."""
    pitch_deg = pose.pitch_deg + math.degrees(rotation_rad(motion.across_mm, pose.depth_mm))
    return Pose(pose.depth_mm + motion.along_mm, pitch_deg, pose.jaws_mm + motion.apart_mm)
