"""The file that says how strong a device feels: from a pattern's amplitude to the drive of the device.

A pattern's amplitude is the intensity that is to be felt; the profile has the drive at which it is. The guard
applies it before its limits, so they bound the drive. `haptigraph devices calibrate` writes such files.
"""

import datetime
import math
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Literal, TypeAlias

import numpy as np
from msgspec import Meta, Struct
from msgspec.structs import replace

from haptigraph.config import HapticsConfig
from haptigraph.errors import BadInput
from haptigraph.haptics.observed_device import is_felt
from haptigraph.messages import Capabilities
from haptigraph.toml_document import Document

__all__ = [
    "OWN_SCALE",
    "Basis",
    "DetectionThreshold",
    "DeviceProfile",
    "Intensity",
    "Latency",
    "Onset",
    "Point",
    "ProfiledDevice",
    "Provenance",
    "check_device",
    "load_profile",
    "open_profile",
    "parse_profile",
]

Basis: TypeAlias = Literal["measured", "answers", "literature", "judgement"]
"""By an instrument or a clock; from a person's answers in a procedure; published; somebody's opinion."""
Text: TypeAlias = Annotated[str, Meta(min_length=1, max_length=1000)]
Share: TypeAlias = Annotated[float, Meta(gt=0, le=1)]
Milliseconds: TypeAlias = Annotated[float, Meta(gt=0, le=2000)]
Hertz: TypeAlias = Annotated[float, Meta(ge=1, le=1000)]
OWN_SCALE = "own"
SD_OF_95 = 2 * 1.96
"""Width of an interval of 95 % in standard deviations."""


class ProfiledDevice(Struct, frozen=True, forbid_unknown_fields=True):
    """The [device] table."""

    uri: Text
    """As for --device."""
    description: Text
    """Actuator, board, and where it touches the skin."""


class Provenance(Struct, frozen=True, forbid_unknown_fields=True):
    """The [provenance] table: who measured what, when and how."""

    by: Text
    """A pseudonym."""
    date: datetime.date
    how: Text


class Latency(Struct, frozen=True, forbid_unknown_fields=True):
    """The [latency] table: the round trip of a command. Reported, not used."""

    basis: Basis
    source: Text
    commands: Annotated[int, Meta(ge=20)]
    p50_ms: Milliseconds
    p50_low_ms: Milliseconds
    p50_high_ms: Milliseconds
    p95_ms: Milliseconds
    p95_low_ms: Milliseconds
    p95_high_ms: Milliseconds


class Onset(Struct, frozen=True, forbid_unknown_fields=True):
    """The [onset] table: how long a burst must last to be felt."""

    basis: Basis
    source: Text
    shortest_on_ms: Milliseconds
    """Shorter bursts are lengthened to this."""
    low_ms: Milliseconds
    """Start of its interval of 95 %."""
    high_ms: Milliseconds


class DetectionThreshold(Struct, frozen=True, forbid_unknown_fields=True):
    """The [threshold] table: the drive below which nothing is felt."""

    basis: Basis
    source: Text
    drive: Share
    """Felt half of the time."""
    low: Share
    """Start of its interval of 95 %."""
    high: Share


class Point(Struct, frozen=True, forbid_unknown_fields=True):
    """An [[intensity.point]]: how strong one drive feels."""

    drive: Share
    intensity: Share
    """Perceived, relative to that of the scale."""
    sd: Annotated[float, Meta(ge=0, le=1)]
    """Standard deviation of the intensity."""


class Intensity(Struct, frozen=True, forbid_unknown_fields=True):
    """The [intensity] table."""

    basis: Basis
    source: Text
    scale: Text
    """What intensity 1 is: "own", this device at the largest drive; or another device at full amplitude."""
    point: tuple[Point, ...]
    """In order; at least two."""
    frequency_hz: Hertz | None = None
    """At which it was measured; unset: the device has one of its own."""


class DeviceProfile(Struct, frozen=True, forbid_unknown_fields=True):
    """The contents of a profile."""

    device: ProfiledDevice
    provenance: Provenance
    threshold: DetectionThreshold
    intensity: Intensity
    format: Literal[1] = 1
    onset: Onset | None = None
    """Unset: as the device's class states."""
    latency: Latency | None = None

    @property
    def strongest(self) -> float:
        """The strongest intensity that is known."""
        return self.intensity.point[-1].intensity

    def drive_at(self, intensity: float) -> float:
        """Return the drive that is felt as an intensity; never one beyond those that were measured.

        Between points, the logarithms of drive and intensity are interpolated linearly, so that a power law
        is exact. Below the first point both are linear, down to the threshold.
        """
        if intensity <= 0:
            return 0.0
        points, first = self.intensity.point, self.intensity.point[0]
        if intensity < first.intensity:
            share = intensity / first.intensity
            return self.threshold.drive + share * (first.drive - self.threshold.drive)
        return _interpolated(intensity, [each.intensity for each in points], [each.drive for each in points])

    def intensity_at(self, drive: float) -> float:
        """Return how strong a drive feels; 0 up to the threshold, at most that of the last point."""
        points, first = self.intensity.point, self.intensity.point[0]
        if drive <= self.threshold.drive:
            return 0.0
        if drive < first.drive:
            share = (drive - self.threshold.drive) / (first.drive - self.threshold.drive)
            return share * first.intensity
        return _interpolated(drive, [each.drive for each in points], [each.intensity for each in points])

    def sd_at(self, intensity: float) -> float:
        """Return the standard deviation of the intensity that is felt where one is asked for.

        Below the first point nothing was measured but the threshold. There it includes the difference between
        a straight line and the power law of the first two points.
        """
        points = self.intensity.point
        first, second = points[:2]
        if intensity >= first.intensity:
            return float(
                np.interp(intensity, [each.intensity for each in points], [each.sd for each in points])
            )
        steepness = first.intensity / (first.drive - self.threshold.drive)
        at_threshold = steepness * (self.threshold.high - self.threshold.low) / SD_OF_95
        measured = float(np.interp(intensity, [0.0, first.intensity], [at_threshold, first.sd]))
        exponent = math.log(second.intensity / first.intensity) / math.log(second.drive / first.drive)
        by_power = first.intensity * (self.drive_at(intensity) / first.drive) ** exponent
        return min(math.hypot(measured, by_power - intensity), first.intensity)

    def applied_to(self, capabilities: Capabilities) -> Capabilities:
        """Return a device's capabilities with what was measured of it."""
        if self.onset is None:
            return capabilities
        return replace(capabilities, shortest_on_ms=self.onset.shortest_on_ms)


def load_profile(path: str | Path) -> DeviceProfile:
    """Read a profile.

    Raises:
        BadInput: If it cannot be read or is not valid.
    """
    return parse_profile(Document.read(path).text, path)


def parse_profile(text: str, file: str | Path) -> DeviceProfile:
    """Read a profile from text; `file` names it in errors.

    Raises:
        BadInput: If it is damaged, or claims what cannot be.
    """
    document = Document(text, file)
    profile = document.convert(DeviceProfile)
    _check_intervals(document, profile)
    _check_points(document, profile.threshold.drive, profile.intensity)
    return profile


def open_profile(config: HapticsConfig) -> tuple[DeviceProfile | None, str]:
    """Return the profile of a configuration's device, and its text; None and "" if there is none.

    Raises:
        BadInput: If it cannot be used, or is of another kind of device.
    """
    if not config.profile:
        return None, ""
    text = Document.read(config.profile).text
    profile = parse_profile(text, config.profile)
    check_device(profile, config.device, config.profile)
    return profile, text


def check_device(profile: DeviceProfile, device: str, file: str | Path) -> None:
    """Refuse a profile of another kind of device; what nobody feels (console, trace) may rehearse any.

    Raises:
        BadInput: If it is of another kind.
    """
    kind, measured = device.partition(":")[0], profile.device.uri.partition(":")[0]
    if is_felt(device) and kind != measured:
        problem = f"is the profile of {profile.device.uri}, not of {device}"
        raise BadInput(f"{problem}; measure one: haptigraph devices calibrate {device} -o FILE", file)


def _interpolated(value: float, inputs: Sequence[float], outputs: Sequence[float]) -> float:
    logs = np.interp(math.log(value), np.log(inputs), np.log(outputs))
    return float(min(max(math.exp(logs), outputs[0]), outputs[-1]))  # a rounding error must not exceed 1


def _check_intervals(document: Document, profile: DeviceProfile) -> None:
    threshold, onset, latency = profile.threshold, profile.onset, profile.latency
    intervals = [("threshold.drive", threshold.low, threshold.drive, threshold.high)]
    if onset is not None:
        intervals.append(("onset.shortest_on_ms", onset.low_ms, onset.shortest_on_ms, onset.high_ms))
    for path, low, value, high in intervals:
        if not low <= value <= high or low == high:
            problem = f"found {value:g} with an interval of {low:g} to {high:g}"
            raise document.error(f"{path}: {problem}; the interval must contain it and have a width", path)
    if latency is not None:
        p50 = latency.p50_low_ms <= latency.p50_ms <= latency.p50_high_ms
        p95 = latency.p95_low_ms <= latency.p95_ms <= latency.p95_high_ms
        if not (p50 and p95 and latency.p50_ms <= latency.p95_ms):
            raise document.error("expected p50_ms <= p95_ms, each within its interval", "latency.p50_ms")


def _check_points(document: Document, threshold: float, intensity: Intensity) -> None:
    points = intensity.point
    if len(points) < 2:
        raise document.error(f"expected two points or more, found {len(points)}", "intensity.point")
    if points[0].drive <= threshold:
        problem = f"drive {points[0].drive:g} is felt, but the threshold is {threshold:g}"
        raise document.error(f"{problem}; a point lies above it", "intensity.point[0].drive")
    for number, (before, after) in enumerate(pairwise(points), 1):
        if after.drive <= before.drive or after.intensity <= before.intensity:
            problem = (
                f"drive {before.drive:g} feels {before.intensity:g}, drive {after.drive:g} feels "
                f"{after.intensity:g}; expected both to increase from point to point"
            )
            raise document.error(problem, f"intensity.point[{number}]")
    for number, point in enumerate(points):
        is_unit = intensity.scale == OWN_SCALE and point is points[-1] and point.intensity == 1
        if not point.sd and not is_unit:
            problem = f"intensity {point.intensity:g} is stated without uncertainty; give an sd above 0"
            raise document.error(problem, f"intensity.point[{number}]")
