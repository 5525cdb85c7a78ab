"""The robot's own tip as an entity of the scene, besides what a perceiver finds in the image.

Poses of the robot, each with its stamp, become one position at the stamp of the image. Between two samples it
is interpolated. After the newest it is extrapolated, with growing standard deviation, but no further than
`AHEAD_MS`; a tip that would be older is not reported.
"""

from math import hypot

from msgspec.structs import replace

from haptigraph.geometry import Point
from haptigraph.messages import Capture, Fault, Observation, RobotSample
from haptigraph.perception.entities import ROBOT_TIP
from haptigraph.stages import Perceiver

__all__ = ["AHEAD_MS", "RobotTipPerceiver"]

AHEAD_MS = 60.0
"""How far beyond the newest sample the tip is extrapolated; how long a gap is interpolated."""
SPEED_MS = 40.0  # over which the speed is measured, so that the noise of two samples does not decide it
ACCELERATION_MM_S2 = 100.0  # of a hand with tremor behind a motion scale of 0.2; the sd of what is unforeseen
KEPT_MS = 300.0
NS_PER_MS = 1e6


class RobotTipPerceiver:
    """Add the tip that the robot reports to what a perceiver finds.

    Nothing is added while the robot is not calibrated, its newest pose is stale, or the standard deviation of
    its tip is unknown and therefore no comparison possible. The first such image has a fault.

    Args:
        perceiver: Processes the image.
        timing_sd_ms: Standard deviation of the time between the image's and the robot's stamps.
    """

    def __init__(self, perceiver: Perceiver, timing_sd_ms: float) -> None:
        self._perceiver, self._timing_sd_ms = perceiver, timing_sd_ms
        self._samples: list[RobotSample] = []
        self._is_missing = False

    def __call__(self, capture: Capture) -> Observation:
        """Observe one image."""
        observation = self._perceiver(capture)
        self._samples = self._recent(capture)
        try:
            tip, sd_mm = self._tip_at(capture.stamp_ns)
        except LookupError as missing:
            return self._without(observation, str(missing))
        self._is_missing = False
        return replace(
            observation,
            found={**observation.found, ROBOT_TIP: tip},
            sd_mm={**observation.sd_mm, ROBOT_TIP: sd_mm},
        )

    def reset(self) -> None:
        """Forget earlier images and samples."""
        self._perceiver.reset()
        self._samples, self._is_missing = [], False

    def _recent(self, capture: Capture) -> list[RobotSample]:
        """Return the samples that still matter, in order; a repeated or late stamp is left out."""
        kept = [one for one in self._samples if _ms(capture.stamp_ns - one.stamp_ns) <= KEPT_MS]
        for sample in capture.robot:
            if not kept or sample.stamp_ns > kept[-1].stamp_ns:
                kept.append(sample)
        return kept

    def _without(self, observation: Observation, problem: str) -> Observation:
        if self._is_missing:
            return observation
        self._is_missing = True
        return replace(observation, faults=(*observation.faults, Fault("robot", problem)))

    def _tip_at(self, stamp_ns: int) -> tuple[Point, float]:
        """Return the tip at a time, and its standard deviation per axis [mm].

        Raises:
            LookupError: If it is not known; the message says why.
        """
        earlier = [one for one in self._samples if one.stamp_ns <= stamp_ns]
        later = self._samples[len(earlier) :]
        if not earlier:
            raise LookupError("the robot's tip is not known: no pose from before the image")
        last = earlier[-1]
        if last.eye_tip_mm is None or last.eye_tip_sd_mm is None:
            raise LookupError("the robot's tip is not known in the eye: it is not calibrated")
        gap_ms = _ms((later[0] if later else last).stamp_ns - last.stamp_ns)
        after_ms = _ms(stamp_ns - last.stamp_ns)
        if max(gap_ms, after_ms) > AHEAD_MS:
            raise LookupError(f"the robot's tip is not known: its newest pose is {after_ms:.0f} ms old")
        one, other = (last, later[0]) if later else (self._before(last), last)
        speed = _speed_mm_ms(one, other)
        x, y, z = (at + after_ms * v for at, v in zip(last.eye_tip_mm, speed, strict=True))
        ahead_s = 0.0 if later else after_ms / 1e3
        sd_mm = hypot(
            last.eye_tip_sd_mm, hypot(*speed) * self._timing_sd_ms, ACCELERATION_MM_S2 * ahead_s**2 / 2
        )
        return Point((x, y), z), sd_mm

    def _before(self, last: RobotSample) -> RobotSample:
        """Return the earliest sample over which the speed at the newest one is measured."""
        return next(one for one in self._samples if _ms(last.stamp_ns - one.stamp_ns) <= SPEED_MS)


def _speed_mm_ms(one: RobotSample, other: RobotSample) -> tuple[float, float, float]:
    start_mm, end_mm, ms = one.eye_tip_mm, other.eye_tip_mm, _ms(other.stamp_ns - one.stamp_ns)
    if start_mm is None or end_mm is None or ms <= 0:
        return 0.0, 0.0, 0.0
    x, y, z = ((end - start) / ms for start, end in zip(start_mm, end_mm, strict=True))
    return x, y, z


def _ms(ns: int) -> float:
    return ns / NS_PER_MS
