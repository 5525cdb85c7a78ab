"""The hand that holds a force device, as a leader: its motion steers what it feels.

The tip moves as the hand does, in directions of the eye frame, because forces are placed so. A tool moves
along and across its shaft, so the motion is resolved in the direction of the shaft.
"""

import math
from collections import deque
from collections.abc import Sequence

from haptigraph.clock import Clock
from haptigraph.errors import DeviceError
from haptigraph.geometry import Segment, Vec, subtract, unit
from haptigraph.messages import ForceSample, Step
from haptigraph.robot.pose import Vec3
from haptigraph.teleop.leaders.leader import MAX_STEP_MM
from haptigraph.teleop.motion import HandMotion

__all__ = ["ForceHand"]

MAX_SAMPLES = 10_000
SILENCE_MS = 100.0
SILENT_TAKES = 5
"""In a row; so that a run which was itself held up does not count as a silent device."""


class ForceHand:
    """Turn the samples of a force device into hand motion. Any thread may call `add` and `see`.

    Args:
        clock: Measures since when it is silent.
    """

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._samples: deque[ForceSample] = deque(maxlen=MAX_SAMPLES)
        self._heard_ns = clock.now_ns()
        self._silent_takes = 0
        self._last_mm: Vec3 | None = None
        self._shaft: Vec = (0.0, -1.0)

    def see(self, step: Step) -> None:
        """Take the direction of the shaft from the newest step; without one the last stays."""
        line = step.observation.found.get("needle_line")
        if isinstance(line, Segment) and line.start_mm != line.end_mm:
            self._shaft = unit(subtract(line.end_mm, line.start_mm))

    def add(self, sample: ForceSample) -> None:
        """Take a sample, in the order of their stamps."""
        self._samples.append(sample)

    def take(self) -> Sequence[HandMotion]:
        """Return the motions since the last call.

        Raises:
            DeviceError: If the device is silent.
        """
        motions = [self._motion(self._samples.popleft()) for _ in range(len(self._samples))]
        now_ns = self._clock.now_ns()
        self._silent_takes = 0 if motions else self._silent_takes + 1
        if motions:
            self._heard_ns = now_ns
        elif now_ns - self._heard_ns > SILENCE_MS * 1e6 and self._silent_takes >= SILENT_TAKES:
            self._last_mm = None
            raise DeviceError(f"no position of the hand for {SILENCE_MS:g} ms")
        return motions

    def close(self) -> None:
        """Do nothing: the force output closes the device."""

    def _motion(self, sample: ForceSample) -> HandMotion:
        """Return the motion since the sample before; a jump counts as a release of the clutch."""
        last_mm, self._last_mm = self._last_mm, None
        if not sample.is_engaged or not all(map(math.isfinite, sample.hand_mm)):
            return HandMotion(engaged=False)
        self._last_mm = sample.hand_mm
        right_mm, up_mm, towards_mm = (
            now - before for now, before in zip(sample.hand_mm, last_mm or sample.hand_mm, strict=True)
        )
        if max(map(abs, (right_mm, up_mm, towards_mm))) > MAX_STEP_MM:
            return HandMotion(engaged=False)
        x, y = self._shaft
        along_mm, across_mm = right_mm * x + up_mm * y, up_mm * x - right_mm * y
        return HandMotion(True, along_mm=along_mm, across_mm=across_mm, outwards_mm=towards_mm)
