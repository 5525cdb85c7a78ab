"""Haptic perception of a simulated operator: classifies the device's amplitudes into the cues of the grammar.

The cues are those taught in training: steady or slow vibration is guidance, strong rapid pulses are an alarm,
two strong bursts signal success.
"""

from bisect import bisect_right
from typing import Literal

from msgspec import Struct

__all__ = ["NO_PERCEPT", "TRAIN_S", "HapticPerception", "Percept"]

STRONG = 0.7  # alarm and success are stronger, guidance is weaker
MAX_PULSE_S = 0.25  # shorter vibration is a pulse
MAX_PAUSE_S = 0.7  # between pulses of guidance
TRAIN_S = 0.8  # three strong bursts within this time are an alarm
PAIR_S = 0.25  # two strong bursts, then silence for this time, are success
MAX_CHANGES = 24  # that a percept depends on


class Percept(Struct, frozen=True):
    """What is perceived at one moment."""

    cue: Literal["none", "guidance", "strong", "alarm", "success"]
    """"strong" is still ambiguous: it becomes alarm or success."""
    amplitude: float = 0.0
    """Amplitude of guidance."""


NO_PERCEPT = Percept("none")


class HapticPerception:
    """A record of the device's output that returns the percept at any moment.

    Args:
        absolute_threshold: Lowest amplitude that is felt.
    """

    def __init__(self, absolute_threshold: float) -> None:
        self._absolute_threshold = absolute_threshold
        self._times_s: list[float] = []
        self._amplitudes: list[float] = []
        self._bursts: tuple[int, list[_Burst]] = 0, []
        """Those until a number of changes."""

    def add(self, time_s: float, amplitude: float) -> None:
        """Add a change of the device's amplitude, in order of time."""
        self._times_s.append(time_s)
        self._amplitudes.append(amplitude if amplitude >= self._absolute_threshold else 0.0)

    def at(self, time_s: float) -> Percept:
        """Return the percept at a moment."""
        end = bisect_right(self._times_s, time_s)
        if end != self._bursts[0]:
            first = max(end - MAX_CHANGES, 0)
            self._bursts = end, _bursts(self._times_s[first:end], self._amplitudes[first:end])
        bursts = self._bursts[1]
        if not bursts:
            return NO_PERCEPT
        strong = [
            burst for burst in bursts if burst.amplitude >= STRONG and time_s - burst.start_s <= TRAIN_S
        ]
        if len(strong) >= 3:
            return Percept("alarm")
        if strong:
            since_s = time_s - strong[-1].start_s
            if len(strong) == 2 and since_s >= PAIR_S:
                return Percept("success")
            return Percept("strong") if since_s < PAIR_S else NO_PERCEPT
        last = bursts[-1]
        is_pulse = last.end_s is not None and last.end_s - last.start_s < MAX_PULSE_S
        silent_s = 0.0 if last.end_s is None else time_s - last.end_s
        if silent_s > 0 and not (is_pulse and silent_s < MAX_PAUSE_S):
            return NO_PERCEPT
        return Percept("guidance", last.amplitude)


class _Burst(Struct):
    start_s: float
    amplitude: float
    """The most recent amplitude of the burst."""
    end_s: float | None = None
    """None while it continues."""


def _bursts(times_s: list[float], amplitudes: list[float]) -> list[_Burst]:
    bursts: list[_Burst] = []
    is_on = False
    for time_s, amplitude in zip(times_s, amplitudes, strict=True):
        if amplitude > 0 and is_on:
            bursts[-1].amplitude = amplitude
        elif amplitude > 0:
            bursts.append(_Burst(time_s, amplitude))
        elif is_on:
            bursts[-1].end_s = time_s
        is_on = amplitude > 0
    return bursts
