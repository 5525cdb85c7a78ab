"""The sense of touch of a simulated operator: amplitudes at the device become what a person would say it was.

Told every change of the device, asked about any moment after it. Knows the words of the haptic grammar as
training teaches them: steady or slow vibration guides, strong quick pulses alarm, two strong bursts praise.
Knows no states.
"""

from bisect import bisect_right
from typing import Literal

from msgspec import Struct

__all__ = ["NOTHING", "TRAIN_S", "Felt", "SenseOfTouch"]

STRONG = 0.7  # alarm and praise are stronger, guidance is weaker
PULSE_S = 0.25  # shorter vibration is one of several
RHYTHM_S = 0.7  # pulses that guide come at least so often
TRAIN_S = 0.8  # three strong bursts within it are an alarm,
PAIR_S = 0.25  # two and then silence for so long are praise
LOOKED_AT = 24  # changes before a moment


class Felt(Struct, frozen=True):
    """What is felt at one moment."""

    word: Literal["nothing", "guidance", "strong", "alarm", "praise"]
    """What is "strong" may yet become an alarm or praise."""
    share: float = 0.0
    """Strength of what guides: the device's amplitude."""


NOTHING = Felt("nothing")


class SenseOfTouch:
    """Remember what a device did.

    Args:
        faintest: Weaker vibration is not felt.
    """

    def __init__(self, faintest: float) -> None:
        self._faintest = faintest
        self._times_s: list[float] = []
        self._amplitudes: list[float] = []

    def tell(self, time_s: float, amplitude: float) -> None:
        """Take a change of the device, in order."""
        self._times_s.append(time_s)
        self._amplitudes.append(amplitude if amplitude >= self._faintest else 0.0)

    def at(self, time_s: float) -> Felt:
        """Return what was felt at a moment."""
        end = bisect_right(self._times_s, time_s)
        first = max(end - LOOKED_AT, 0)
        bursts = _bursts(self._times_s[first:end], self._amplitudes[first:end])
        if not bursts:
            return NOTHING
        strong = [
            burst for burst in bursts if burst.amplitude >= STRONG and time_s - burst.start_s <= TRAIN_S
        ]
        if len(strong) >= 3:
            return Felt("alarm")
        if strong:
            over_s = time_s - strong[-1].start_s
            if len(strong) == 2 and over_s >= PAIR_S:
                return Felt("praise")
            return Felt("strong") if over_s < PAIR_S else NOTHING
        last = bursts[-1]
        is_pulse = last.end_s is not None and last.end_s - last.start_s < PULSE_S
        silent_s = 0.0 if last.end_s is None else time_s - last.end_s
        if silent_s > 0 and not (is_pulse and silent_s < RHYTHM_S):
            return NOTHING
        return Felt("guidance", last.amplitude)


class _Burst(Struct):
    start_s: float
    amplitude: float
    """The last one while it lasted."""
    end_s: float | None = None
    """None while it lasts."""


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
