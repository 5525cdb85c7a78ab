"""Turn the motion of a hand into motion of the robot: clutch, tremor filter, motion scale, RCM constraint.

The motion is relative: for each image the robot moves from its current pose by the displacement of the hand.
So nothing winds up at a limit, a change of settings cannot make the needle jump, and without input it stays.
"""

import math
import threading
from collections.abc import Sequence

import numpy as np

from haptigraph.geometry import subtract
from haptigraph.messages import HandState
from haptigraph.sim.robot.operator import Tremor
from haptigraph.sim.robot.robot import Pose, Robot
from haptigraph.teleop.band_stop import TREMOR_HZ, BandStop
from haptigraph.teleop.motion import HandMotion, TeleopSettings

__all__ = ["Teleop"]

MIN_LEVER_MM = 5.0
"""Minimum lever: nearer to the RCM the rotation is reduced, because at the RCM no rotation moves the tip."""
TIMEOUT_S = 0.25
"""Without a message for this time the clutch is released."""


class Teleop:
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
        self.settings = settings or TeleopSettings()
        """May be replaced at any time, from any thread; takes effect at the next image."""
        self.has_jaws = has_jaws
        self._filter = BandStop(rate_hz)
        self._tremor = Tremor(1.0, *TREMOR_HZ, seed)
        self._lock = threading.Lock()
        self._pending: HandMotion | None = None
        self._engaged = self._released = False
        self._idle_s = 0.0
        self.hand = _state(self.settings, engaged=False)
        """The state of the hand for the last image."""

    def put(self, motion: HandMotion) -> None:
        """Take one message of the hand; it takes effect at the next image.

        Releasing the clutch discards pending motion, so that the needle stops at once.
        """
        with self._lock:
            before = self._pending
            if motion.engaged and before is not None and before.engaged:
                motion = HandMotion(
                    True,
                    before.along_mm + motion.along_mm,
                    before.across_mm + motion.across_mm,
                    before.apart_mm + motion.apart_mm,
                    before.outwards_mm + motion.outwards_mm,
                )
            self._released |= not motion.engaged
            self._pending = motion

    def move(self, robot: Robot, time_s: float, elapsed_s: float) -> None:
        """Move the robot by the displacement of the hand during one image."""
        with self._lock:
            motion, self._pending = self._pending, None
            released, self._released = self._released, False
        settings = self.settings
        self._idle_s = 0.0 if motion else self._idle_s + elapsed_s
        self._engaged = motion.engaged if motion else self._engaged and self._idle_s < TIMEOUT_S
        if released or not (self._engaged and settings.tremor_filter):
            self._filter.reset()
        self.hand = _state(settings, engaged=self._engaged)
        if not self._engaged:
            return
        hand_mm = 0.0, 0.0, 0.0
        if motion:
            apart_mm = motion.apart_mm if self.has_jaws else 0.0
            hand_mm = float(motion.along_mm), float(motion.across_mm), float(apart_mm)
        along_mm, across_mm, apart_mm = hand_mm
        if settings.added_tremor_mm:  # the whole hand trembles, not finger against thumb
            tremor = subtract(self._tremor.at(time_s), self._tremor.at(time_s - elapsed_s))
            along_mm += settings.added_tremor_mm * tremor[0]
            across_mm += settings.added_tremor_mm * tremor[1]
        if settings.tremor_filter:
            along_mm, across_mm = self._filter(np.array((along_mm, across_mm))).tolist()
        scale = settings.motion_scale  # last, so that a scale of 0 stops at once
        commanded_mm = scale * along_mm, scale * across_mm, scale * apart_mm
        robot.follow(_moved(robot.pose, *commanded_mm), elapsed_s)
        self.hand = _state(settings, True, hand_mm, commanded_mm)

    def is_away(self, time_s: float) -> bool:
        """Return False: a hand removes the needle from the image only along its shaft."""
        return False


def _moved(pose: Pose, along_mm: float, across_mm: float, apart_mm: float) -> Pose:
    """Return the pose after a motion of tip and jaws; motion across becomes a rotation about the RCM."""
    rotation = across_mm * pose.depth_mm / max(pose.depth_mm**2, MIN_LEVER_MM**2)
    return Pose(pose.depth_mm + along_mm, pose.pitch_deg + math.degrees(rotation), pose.jaws_mm + apart_mm)


def _state(
    settings: TeleopSettings,
    engaged: bool,
    hand_mm: Sequence[float] = (0.0, 0.0, 0.0),
    commanded_mm: Sequence[float] = (0.0, 0.0, 0.0),
) -> HandState:
    return HandState(
        engaged=engaged,
        along_mm=hand_mm[0],
        across_mm=hand_mm[1],
        asked_along_mm=commanded_mm[0],
        asked_across_mm=commanded_mm[1],
        motion_scale=settings.motion_scale,
        tremor_filter=settings.tremor_filter,
        added_tremor_mm=settings.added_tremor_mm,
        apart_mm=hand_mm[2],
        asked_apart_mm=commanded_mm[2],
    )
