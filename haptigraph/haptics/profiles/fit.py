"""What a device does not give of a pattern as meant, by its profile: too weak, not felt, not measured.

Pure functions; a run reports their sentences before it starts, `haptigraph check` proves their absence.
"""

from collections.abc import Sequence

from haptigraph.haptics.pattern import amplitude_range
from haptigraph.haptics.profiles.profile import OWN_SCALE, DeviceProfile
from haptigraph.messages import Pattern

__all__ = ["misfits", "profile_notes", "unmeasured"]

NOTICEABLE = 0.1
"""Smallest relative difference that is noticed: 0.1 to 0.3 in Craig 1972 and Gescheider et al. 1990."""
SAME_HZ = 1.1
"""Ratio of frequencies up to which a measured intensity is taken to hold; our choice."""


def misfits(pattern: Pattern, profile: DeviceProfile, max_drive: float = 1.0) -> list[str]:
    """Return what a device does not give of a pattern as meant, one sentence each.

    Args:
        pattern: A pattern; one that follows a measure is judged at both ends.
        profile: Of the device.
        max_drive: Limit of the guard.
    """
    weakest, strongest = amplitude_range((pattern,))
    if not strongest:
        return []
    sentences, threshold = [], profile.threshold
    given = profile.intensity_at(min(profile.drive_at(strongest), max_drive))
    if given * (1 + NOTICEABLE) < strongest:
        whose = "the limit of the amplitude allows" if max_drive < 1 else "is known of the device"
        sentences.append(
            f"{pattern.name}: amplitude {strongest:g} is felt as {given:.2g}, the strongest that {whose}"
        )
    drive = min(profile.drive_at(weakest), max_drive)
    if drive <= threshold.high:
        sentences.append(
            f"{pattern.name}: amplitude {weakest:g} may not be felt: its drive is {drive:.2g}, the "
            f"threshold {threshold.low:.2g} to {threshold.high:.2g}"
        )
    return sentences


def unmeasured(patterns: Sequence[Pattern], profile: DeviceProfile) -> list[str]:
    """Return, in one sentence, the patterns of other frequencies than the one that was measured."""
    measured_hz = profile.intensity.frequency_hz
    if measured_hz is None:
        return []
    others = [
        f"{pattern.name} ({pattern.frequency_hz:g} Hz)"
        for pattern in patterns
        if pattern.kind != "off"
        and pattern.frequency_hz
        and not 1 / SAME_HZ <= pattern.frequency_hz / measured_hz <= SAME_HZ
    ]
    if not others:
        return []
    return [f"how strong {', '.join(others)} feels: the profile was measured at {measured_hz:g} Hz"]


def profile_notes(
    profile: DeviceProfile, device: str, patterns: Sequence[Pattern], max_drive: float
) -> list[str]:
    """Return what the user should know of a profile before a run, a sentence each.

    Args:
        profile: The profile.
        device: What the run vibrates with.
        patterns: The procedure's.
        max_drive: Limit of the guard.
    """
    made, intensity = profile.provenance, profile.intensity
    notes = [
        f"amplitudes are perceived intensities, by the profile of {profile.device.uri} ({intensity.basis}: "
        f"{made.by}, {made.date})"
    ]
    if device != profile.device.uri:
        notes.append(f"the profile was measured on {profile.device.uri}, not on {device}")
    if intensity.scale == OWN_SCALE:
        notes.append("intensity 1 is this device's own strongest, which may differ from another device's")
    if max_drive:  # else nothing vibrates
        notes += [sentence for pattern in patterns for sentence in misfits(pattern, profile, max_drive)]
    return notes + [f"not known: {sentence}" for sentence in unmeasured(patterns, profile)]
