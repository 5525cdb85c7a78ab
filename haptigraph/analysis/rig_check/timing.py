"""Check the times of images: their rate, how even it is, gaps, and images that were not taken."""

from collections.abc import Iterator

import numpy as np

from haptigraph.analysis.rig_check.clip import Clip
from haptigraph.analysis.rig_check.subject import Subject
from haptigraph.findings import Finding

__all__ = ["timing"]

MIN_RATE_HZ = 24.5
"""At 25 images/s a needle at 17 mm/s crosses the 0.7 mm before the retina within one image."""
MIN_RATE_SHARE = 0.9
"""Of the nominal rate."""
MAX_UNEVEN_SHARE = 0.5
"""95th percentile of the deviation from the median interval, as a share of it."""
MAX_MISSING_SHARE = 0.02
MAX_GAP_MS = 100.0
"""As run.stale_ms: after a longer gap a run reports a stale image and falls silent."""
GAP_INTERVALS = 1.5  # of the median interval: an image is missing


def timing(clip: Clip) -> Subject:
    """Judge the rate of images."""
    if not clip.is_timed:
        return Subject(
            "frame rate", not_judged="the times of these images are a setting, not measured; use a camera"
        )
    steps = np.diff(clip.indices).clip(1)
    intervals_ms = np.diff(clip.stamps_ns) / 1e6 / steps  # what this program did not take is no gap
    typical_ms = float(np.median(intervals_ms))
    duration_s = float(clip.stamps_ns[-1] - clip.stamps_ns[0]) / 1e9
    gaps = intervals_ms[intervals_ms > GAP_INTERVALS * typical_ms]
    missing = float(np.rint(gaps / max(typical_ms, 1e-6) - 1).sum())
    measured = {
        "rate_hz": float(steps.sum()) / duration_s if duration_s > 0 else 0.0,
        "nominal_hz": clip.rate_hz,
        "uneven_share": float(np.percentile(np.abs(intervals_ms - typical_ms), 95)) / max(typical_ms, 1e-6),
        "longest_gap_ms": float(intervals_ms.max()),
        "missing_share": missing / (missing + len(clip.stamps_ns)),
        "not_taken": float((steps - 1).sum()),
    }
    findings = (*_findings(measured), *(Finding("source_lost", each) for each in clip.losses))
    return Subject("frame rate", measured, findings)


def _findings(measured: dict[str, float]) -> Iterator[Finding]:
    rate_hz, needed_hz = measured["rate_hz"], max(MIN_RATE_HZ, MIN_RATE_SHARE * measured["nominal_hz"])
    if rate_hz < needed_hz:
        yield Finding(
            "frame_rate",
            f"{rate_hz:.1f} images/s arrive, nominally {measured['nominal_hz']:g}; at least {needed_hz:.1f} "
            "are valid: shorten the exposure, choose another mode or a faster port, and end what else uses "
            "the processor",
        )
    if (uneven := measured["uneven_share"]) > MAX_UNEVEN_SHARE:
        yield Finding(
            "uneven_rate",
            f"intervals between images vary by {uneven:.0%}; at most {MAX_UNEVEN_SHARE:.0%} is valid: fix "
            "the exposure time, and end what else uses the processor or the port",
        )
    gap_ms, missing = measured["longest_gap_ms"], measured["missing_share"]
    if gap_ms > MAX_GAP_MS or missing > MAX_MISSING_SHARE:
        yield Finding(
            "missing_images",
            f"{missing:.1%} of the images are missing and the longest gap lasts {gap_ms:.0f} ms; at most "
            f"{MAX_MISSING_SHARE:.0%} and {MAX_GAP_MS:g} ms are valid: check cable and port",
        )
