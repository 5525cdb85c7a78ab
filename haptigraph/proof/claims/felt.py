"""What is felt of a pattern: pattern and device -> ranges of amplitude, frequency and rhythm.

Numbers that follow a measure are ranges; a comparison holds for every value in them.
"""

from itertools import product
from typing import NamedTuple

from msgspec import Struct
from msgspec.structs import replace

from haptigraph.haptics.guidance import Guidance
from haptigraph.haptics.pattern import fit_to_device
from haptigraph.haptics.profiles.profile import DeviceProfile
from haptigraph.messages import Capabilities, Pattern

__all__ = ["AMPLITUDE_JND", "Band", "Felt", "are_alike", "felt", "values_of"]

AMPLITUDE_JND = 0.25
"""Just-noticeable relative difference of amplitude: 0.1 to 0.3 in Craig 1972 and Gescheider et al. 1990."""
FREQUENCY_JND = 0.3
"""Of frequency: 0.2 to 0.3 in Goff 1967; Israr, Tan and Reed 2006 found smaller ones."""
PERIOD_JND, BURST_JND = 0.2, 0.3
"""Of the interval between bursts and of their length; our choice, above usual figures for time intervals."""
DISTINCT_AMPLITUDE = 2.0
"""Ratio at which amplitude alone distinguishes patterns; our choice: few levels are known from memory."""
SHORTEST_PAUSE_MS = 20.0
"""Shorter pauses are not felt as such, so the rhythm is lost; our choice, above van Erp's 10 ms (2002)."""


class Band(NamedTuple):
    """A number, or the range in which it follows a measure."""

    low: float
    high: float

    def ratio(self, other: "Band") -> float:
        """Return by what factor two bands differ at least; 1 if they overlap."""
        if not (self.low and other.low):
            return 1.0
        return max(1.0, self.low / other.high, other.low / self.high)


class Felt(Struct, frozen=True):
    """What is felt of one pattern."""

    name: str
    kind: str
    amplitude: Band
    frequency_hz: Band
    """0: left to the device."""
    on_ms: Band
    pause_ms: Band
    count: int

    @property
    def is_steady(self) -> bool:
        """Whether it has no rhythm."""
        return self.kind == "continuous" or (self.kind == "pulses" and self.pause_ms.high < SHORTEST_PAUSE_MS)

    @property
    def period_ms(self) -> Band:
        """Interval between the beginnings of bursts."""
        return Band(self.on_ms.low + self.pause_ms.low, self.on_ms.high + self.pause_ms.high)


def values_of(pattern: Pattern) -> list[Pattern]:
    """Return a pattern as written, and at both ends of everything that it follows."""
    ends: dict[str, set[float]] = {}
    for follow in pattern.follow:
        ends.setdefault(follow.measure, set()).update((follow.start[0], follow.end[0]))
    values = [replace(pattern, follow=())]
    for some in product(*(sorted(each) for each in ends.values())):
        values.append(Guidance()(pattern, dict(zip(ends, some, strict=True))))
    return list(dict.fromkeys(values))


def felt(pattern: Pattern, device: Capabilities | None = None, profile: DeviceProfile | None = None) -> Felt:
    """Return what is felt of a pattern, as written or as a device plays it, by its profile if it has one."""
    values = values_of(pattern)
    if device is not None:
        values = [_played(value, device) for value in values]
    if profile is not None:
        given = [profile.intensity_at(profile.drive_at(value.amplitude)) for value in values]
        values = [replace(value, amplitude=each) for value, each in zip(values, given, strict=True)]

    def band(key: str) -> Band:
        numbers = [float(getattr(value, key)) for value in values]
        return Band(min(numbers), max(numbers))

    return Felt(
        pattern.name,
        pattern.kind,
        band("amplitude"),
        band("frequency_hz"),
        band("on_ms"),
        band("off_ms"),
        pattern.count,
    )


def are_alike(one: Felt, other: Felt) -> bool:
    """Return whether two patterns may be taken for each other: rhythm, frequency and amplitude are close."""
    return not (
        _rhythm_differs(one, other)
        or one.frequency_hz.ratio(other.frequency_hz) >= 1 + FREQUENCY_JND
        or one.amplitude.ratio(other.amplitude) >= DISTINCT_AMPLITUDE
    )


def _rhythm_differs(one: Felt, other: Felt) -> bool:
    """Return whether rhythms differ from the first bursts on; that some end later is felt too late."""
    if one.is_steady or other.is_steady:
        return one.is_steady != other.is_steady
    is_single = 1 in (one.count, other.count)
    return one.on_ms.ratio(other.on_ms) >= 1 + BURST_JND or (
        not is_single and one.period_ms.ratio(other.period_ms) >= 1 + PERIOD_JND
    )


def _played(pattern: Pattern, device: Capabilities) -> Pattern:
    """Return a pattern as a device plays it."""
    if pattern.kind == "off":
        return pattern
    amplitude, frequency_hz = pattern.amplitude, 0.0
    if device.amplitude_levels == 1:
        amplitude = float(amplitude > 0)
    if device.frequency_range_hz is not None and pattern.frequency_hz:
        low_hz, high_hz = device.frequency_range_hz
        frequency_hz = min(max(pattern.frequency_hz, low_hz), high_hz)
    return replace(fit_to_device(pattern, device), amplitude=amplitude, frequency_hz=frequency_hz)
