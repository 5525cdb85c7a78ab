"""Turn the messages of a hand into the motion that a tool is to make: clutch, tremor filter, motion scale.

The motion is relative: each cycle moves the tool from where it is. So nothing winds up at a limit, a change
of settings cannot make the tool jump, and without input it stays.
"""

import threading
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from haptigraph.messages import HandState
from haptigraph.teleop.band_stop import BandStop
from haptigraph.teleop.motion import HandMotion, TeleopSettings

__all__ = ["MIN_LEVER_MM", "TIMEOUT_S", "HandMapping", "ToolMotion", "hand_state", "rotation_rad"]

MIN_LEVER_MM = 5.0
"""Minimum lever: nearer to the RCM the rotation is reduced, because at the RCM no rotation moves the tip."""
TIMEOUT_S = 0.25
"""Without a message for this time the clutch is released."""


class ToolMotion(NamedTuple):
    """Displacement of the tool in one cycle; directions as in `HandMotion`."""

    along_mm: float
    across_mm: float
    outwards_mm: float
    apart_mm: float


STAYS = ToolMotion(0.0, 0.0, 0.0, 0.0)


class HandMapping:
    """A hand's messages, cycle by cycle. Any thread may call `put`; one thread calls `take`.

    Args:
        rate_hz: Cycles per second.
        settings: The initial settings.
        has_jaws: Whether the tool is forceps, which the hand opens and closes.
        spread_s: The motion of a message is spread over the time since the message before, but at most over
            this time; after it a silent hand moves nothing, also not out of the filter. 0: each message takes
            effect in one cycle.

    Raises:
        ValueError: If the rate is too low for the tremor filter.
    """

    def __init__(
        self,
        rate_hz: float,
        settings: TeleopSettings | None = None,
        *,
        has_jaws: bool = False,
        spread_s: float = 0.0,
    ) -> None:
        self.settings = settings or TeleopSettings()
        """May be replaced at any time, from any thread; takes effect in the next cycle."""
        self.has_jaws = has_jaws
        self._filter = BandStop(rate_hz, axes=3)
        self._spread_s = spread_s
        self._lock = threading.Lock()
        self._pending: HandMotion | None = None
        self._engaged = self._released = False
        self._idle_s = 0.0
        self.discard()
        self.hand = hand_state(self.settings, engaged=False)
        """The state of the hand in the last cycle."""

    def put(self, motion: HandMotion) -> None:
        """Take one message of the hand; it takes effect in the next cycle.

        Releasing the clutch discards pending motion, so that the tool stops at once.
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

    def discard(self) -> None:
        """Discard motion that has not taken effect yet."""
        self._left_mm, self._left_s = np.zeros(4), 0.0
        self._filter.reset()

    def take(self, elapsed_s: float, tremor_mm: Sequence[float] = (0.0, 0.0)) -> ToolMotion | None:
        """Return the motion of one cycle; None while the clutch is released.

        Args:
            elapsed_s: Since the cycle before.
            tremor_mm: Added to the hand's motion along and across.
        """
        with self._lock:
            motion, self._pending = self._pending, None
            released, self._released = self._released, False
        settings = self.settings
        silent_s, self._idle_s = self._idle_s + elapsed_s, 0.0 if motion else self._idle_s + elapsed_s
        self._engaged = motion.engaged if motion else self._engaged and self._idle_s < TIMEOUT_S
        if released or not self._engaged:
            self.discard()
        if not settings.tremor_filter:
            self._filter.reset()
        self.hand = hand_state(settings, engaged=self._engaged)
        if not self._engaged:
            return None
        if motion is not None:
            self._add(motion, silent_s)
        if self._spread_s and self._idle_s > self._spread_s:
            return STAYS
        hand_mm = self._share(elapsed_s)
        tool = self._moved(hand_mm, tremor_mm, settings)
        self.hand = hand_state(settings, True, hand_mm, tool)
        return tool

    def _add(self, motion: HandMotion, silent_s: float) -> None:
        apart_mm = motion.apart_mm if self.has_jaws else 0.0
        self._left_mm += (motion.along_mm, motion.across_mm, motion.outwards_mm, apart_mm)
        self._left_s = min(silent_s, self._spread_s)

    def _share(self, elapsed_s: float) -> NDArray[np.float64]:
        """Take the motion of one cycle from what is left of the messages, (4,)."""
        share_mm = self._left_mm * (elapsed_s / self._left_s if self._left_s > elapsed_s else 1.0)
        self._left_mm, self._left_s = self._left_mm - share_mm, self._left_s - elapsed_s
        return share_mm

    def _moved(
        self, hand_mm: NDArray[np.float64], tremor_mm: Sequence[float], settings: TeleopSettings
    ) -> ToolMotion:
        moved_mm = hand_mm[:3] + np.array(
            (*tremor_mm, 0.0)
        )  # the whole hand trembles, not finger against thumb
        if settings.tremor_filter:
            moved_mm = self._filter(moved_mm)
        scale = settings.motion_scale  # last, so that a scale of 0 stops at once
        along_mm, across_mm, outwards_mm = moved_mm.tolist()
        return ToolMotion(scale * along_mm, scale * across_mm, scale * outwards_mm, scale * float(hand_mm[3]))


def rotation_rad(aside_mm: float, depth_mm: float) -> float:
    """Return the rotation about the RCM that moves the tip aside: by the lever, but reduced near the RCM.

    Args:
        aside_mm: Displacement of the tip, across its shaft.
        depth_mm: From the RCM to the tip; negative while the tip is outside, which reverses the rotation.
    """
    return aside_mm * depth_mm / max(depth_mm**2, MIN_LEVER_MM**2)


def hand_state(
    settings: TeleopSettings,
    engaged: bool,
    hand_mm: Sequence[float] | NDArray[np.float64] = STAYS,
    commanded_mm: ToolMotion = STAYS,
) -> HandState:
    """Return the state of a hand as it is recorded.

    Args:
        settings: The settings in force.
        engaged: The clutch.
        hand_mm: Motion of the hand, in the order of `ToolMotion`.
        commanded_mm: What is requested of the tool.
    """
    return HandState(
        engaged=engaged,
        along_mm=float(hand_mm[0]),
        across_mm=float(hand_mm[1]),
        asked_along_mm=commanded_mm.along_mm,
        asked_across_mm=commanded_mm.across_mm,
        motion_scale=settings.motion_scale,
        tremor_filter=settings.tremor_filter,
        added_tremor_mm=settings.added_tremor_mm,
        apart_mm=float(hand_mm[3]),
        asked_apart_mm=commanded_mm.apart_mm,
        outwards_mm=float(hand_mm[2]),
        asked_outwards_mm=commanded_mm.outwards_mm,
    )
