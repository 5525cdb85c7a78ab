"""Turn the motion of a hand into motion of the robot: clutch, tremor filter, motion scale, pivot.

It holds no pose: for each image the robot goes on from where it is, by what the hand has moved. So nothing
winds up at a limit, switching a setting cannot make the needle jump, and a silent hand leaves it where it is.
Knows no input device, no image and no clock but the phantom's.
"""

import math
import threading
from collections.abc import Sequence

import numpy as np

from haptigraph.messages import HandState
from haptigraph.sim.robot.operator import Tremor
from haptigraph.sim.robot.robot import Pose, Robot
from haptigraph.teleop.band_stop import TREMOR_HZ, BandStop
from haptigraph.teleop.motion import HandMotion, TeleopSettings

__all__ = ["Teleop"]

LEVER_MM = 5.0
"""Nearer to the pivot the shaft turns less than the tip's motion asks: in the pivot no turn moves the tip."""
SILENT_S = 0.25
"""A hand that has said nothing for so long has let go."""


class Teleop:
    """A hand as the operator of the phantom. Steered from any thread, moved by the phantom's.

    Args:
        rate_hz: Images per second of the phantom; the hand's motion is looked at once per image.
        settings: To begin with.
        seed: Of the added tremor.
        has_jaws: Whether the tool is forceps, which the hand opens and closes.

    Raises:
        ValueError: If the rate is too low for the tremor filter.
    """

    duration_s = math.inf

    def __init__(
        self, rate_hz: float, settings: TeleopSettings | None = None, seed: int = 0, *, has_jaws: bool = False
    ) -> None:
        self.settings = settings or TeleopSettings()
        """May be replaced at any time, from any thread; it holds from the next image on."""
        self.has_jaws = has_jaws
        self._filter = BandStop(rate_hz)
        self._tremor = Tremor(1.0, *TREMOR_HZ, seed)
        self._lock = threading.Lock()
        self._heard: HandMotion | None = None
        self._engaged = self._let_go = False
        self._silent_s = 0.0
        self.hand = _state(self.settings, engaged=False)
        """What the hand did for the last image."""

    def put(self, motion: HandMotion) -> None:
        """Take one message of the hand; it counts for the next image.

        Letting go forgets what was not carried out yet, so that the needle stops at once.
        """
        with self._lock:
            before = self._heard
            if motion.engaged and before is not None and before.engaged:
                motion = HandMotion(
                    True,
                    before.along_mm + motion.along_mm,
                    before.across_mm + motion.across_mm,
                    before.apart_mm + motion.apart_mm,
                )
            self._let_go |= not motion.engaged
            self._heard = motion

    def move(self, robot: Robot, time_s: float, elapsed_s: float) -> None:
        """Move the robot by what the hand has done in the time of one image."""
        with self._lock:
            heard, self._heard = self._heard, None
            let_go, self._let_go = self._let_go, False
        settings = self.settings
        self._silent_s = 0.0 if heard else self._silent_s + elapsed_s
        self._engaged = heard.engaged if heard else self._engaged and self._silent_s < SILENT_S
        if let_go or not (self._engaged and settings.tremor_filter):
            self._filter.reset()
        self.hand = _state(settings, engaged=self._engaged)
        if not self._engaged:
            return
        hand_mm = np.zeros(3)
        if heard:
            hand_mm[:] = heard.along_mm, heard.across_mm, heard.apart_mm if self.has_jaws else 0.0
        trembled = np.subtract(self._tremor.at(time_s), self._tremor.at(time_s - elapsed_s))
        wanted_mm = hand_mm.copy()
        wanted_mm[:2] += settings.added_tremor_mm * trembled  # a hand trembles; its fingers do so together
        if settings.tremor_filter:
            wanted_mm[:2] = self._filter(wanted_mm[:2])
        asked_mm = settings.motion_scale * wanted_mm  # last, so that a scale of 0 stops at once
        robot.follow(_moved(robot.pose, *asked_mm.tolist()), elapsed_s)
        self.hand = _state(settings, True, hand_mm.tolist(), asked_mm.tolist())

    def is_away(self, time_s: float) -> bool:
        """Return False: a hand never takes the needle out of the picture, but along its shaft."""
        return False


def _moved(pose: Pose, along_mm: float, across_mm: float, apart_mm: float) -> Pose:
    """Return the pose after a motion of tip and jaws; across becomes a turn about the pivot, by the lever."""
    turn = across_mm * pose.depth_mm / max(pose.depth_mm**2, LEVER_MM**2)
    return Pose(pose.depth_mm + along_mm, pose.pitch_deg + math.degrees(turn), pose.jaws_mm + apart_mm)


def _state(
    settings: TeleopSettings,
    engaged: bool,
    hand_mm: Sequence[float] = (0.0, 0.0, 0.0),
    asked_mm: Sequence[float] = (0.0, 0.0, 0.0),
) -> HandState:
    return HandState(
        engaged=engaged,
        along_mm=hand_mm[0],
        across_mm=hand_mm[1],
        asked_along_mm=asked_mm[0],
        asked_across_mm=asked_mm[1],
        motion_scale=settings.motion_scale,
        tremor_filter=settings.tremor_filter,
        added_tremor_mm=settings.added_tremor_mm,
        apart_mm=hand_mm[2],
        asked_apart_mm=asked_mm[2],
    )
