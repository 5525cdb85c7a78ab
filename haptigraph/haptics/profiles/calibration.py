"""From a person's answers to the profile of a device: threshold, intensities, shortest burst. Pure."""

import datetime
from collections.abc import Callable

from msgspec import Struct

from haptigraph.haptics.profiles.measuring import (
    FULL_ON_MS,
    MATCHES,
    ONSET_STIMULI,
    RATINGS,
    THRESHOLD_STIMULI,
    Ask,
    find_onset,
    find_threshold,
    match_intensities,
    rate_intensities,
)
from haptigraph.haptics.profiles.profile import (
    OWN_SCALE,
    DetectionThreshold,
    DeviceProfile,
    Intensity,
    Latency,
    Onset,
    Point,
    ProfiledDevice,
    Provenance,
)
from haptigraph.haptics.profiles.threshold import Threshold

__all__ = ["Calibrated", "calibrate"]

THRESHOLD = f"felt or not, {THRESHOLD_STIMULI} stimuli, one in five silent, adaptive (ZEST)"
ONSET = f"felt or not, {ONSET_STIMULI} bursts, one in five silent, adaptive (ZEST); felt three times of four"
MATCHING = f"compared with the reference, whose amplitude adapted, {MATCHES} pairs a point (ZEST)"
RATING = f"rated relative to the strongest, {RATINGS} times a point (magnitude estimation)"


class Calibrated(Struct, frozen=True):
    """What is calibrated, by whom, and how."""

    uri: str
    description: str
    by: str
    date: datetime.date
    seed: int
    frequency_hz: float | None
    """Of all stimuli; None: the device's own."""
    reference: str = ""
    """The device whose amplitude is the scale; empty: none, intensities are relative to the strongest."""
    max_drive: float = 1.0
    """Largest drive that is played; drives of trials are shares of it."""
    interval_ms: float = 0.0
    """Shortest burst that the device accepts."""
    latency: Latency | None = None


def calibrate(ask: Ask, given: Calibrated, begin: Callable[[str], None] = lambda text: None) -> DeviceProfile:
    """Measure a device.

    Args:
        ask: Plays a trial and returns the answer.
        given: The device and the procedure.
        begin: Called with the instructions of each part before its first trial.

    Raises:
        Unusable: If the answers do not say what was to be measured.
    """
    begin("Part 1 of 3: vibrations near the weakest that you can feel. Some are silent.")
    threshold = find_threshold(ask, "device", given.seed)
    if given.reference:
        begin(
            f"Part 2 of 3: pairs, one on each device. Hold {given.reference} as you hold the other, and say "
            "which vibration was stronger, whatever its pitch."
        )
        points = match_intensities(ask, threshold, given.seed)
        source = MATCHING
    else:
        begin(
            "Part 2 of 3: pairs. The first is 100; give the second a number. "
            "One that feels half as strong is 50."
        )
        points, source = rate_intensities(ask, threshold, given.seed), RATING
    begin("Part 3 of 3: bursts of different lengths. Some are silent.")
    onset = find_onset(ask, points[0].drive, given.seed, given.interval_ms)
    return DeviceProfile(
        device=ProfiledDevice(given.uri, given.description),
        provenance=Provenance(given.by, given.date, f"haptigraph devices calibrate, seed {given.seed}"),
        threshold=_threshold(threshold, given.max_drive),
        onset=None if onset is None else _onset(onset, points[0].drive * given.max_drive),
        latency=given.latency,
        intensity=Intensity(
            basis="answers",
            source=source,
            scale=given.reference or OWN_SCALE,
            point=tuple(Point(each.drive * given.max_drive, each.intensity, each.sd) for each in points),
            frequency_hz=given.frequency_hz,
        ),
    )


def _threshold(found: Threshold, max_drive: float) -> DetectionThreshold:
    drive, low, high = (each * max_drive for each in (found.amplitude, found.low, found.high))
    return DetectionThreshold("answers", THRESHOLD, drive, low, high)


def _onset(found: Threshold, drive: float) -> Onset:
    shortest_ms, low_ms, high_ms = (each * FULL_ON_MS for each in (found.amplitude, found.low, found.high))
    return Onset("answers", f"{ONSET}; drive {drive:.2g}", shortest_ms, low_ms, high_ms)
