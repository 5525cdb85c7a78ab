"""Check whether the picture stands still: the motion of the scene from image to image."""

import cv2
import numpy as np

from haptigraph.analysis.rig_check.subject import Subject
from haptigraph.analysis.rig_check.view import View
from haptigraph.findings import Finding
from haptigraph.imaging import Floats

__all__ = ["stability"]

MAX_JITTER_MM, MAX_JITTER_PX = 0.05, 0.5
"""Largest RMS motion about the mean; the larger holds. An alarm begins 0.7 mm before the retina."""
POINTS, QUALITY, SPACING_PX = 150, 0.005, 8
MIN_POINTS = 15
MIN_IMAGES = 5


def stability(view: View) -> Subject:
    """Judge how far the picture moves while nobody moves the rig."""
    moved_px = _motion_px(view)
    if moved_px is None:
        return Subject("stability", not_judged="too few images, or too few details that can be followed")
    mm = 1 / view.px_per_mm
    jitter_mm = float(np.sqrt(np.mean(np.sum((moved_px - moved_px.mean(axis=0)) ** 2, axis=1)))) * mm
    drift_mm = float(np.hypot(*(moved_px[-3:].mean(axis=0) - moved_px[:3].mean(axis=0)))) * mm
    limit_mm = max(MAX_JITTER_MM, MAX_JITTER_PX * mm)
    measured = {"jitter_mm": jitter_mm, "drift_mm": drift_mm}
    frequency_hz = _frequency_hz(moved_px, view.clip.stamps_ns)
    if jitter_mm <= limit_mm:
        return Subject("stability", measured)
    sentence = (
        f"the picture moves by {jitter_mm:.2f} mm (RMS), mostly at {frequency_hz:.1f} Hz; at most "
        f"{limit_mm:.2f} mm is valid: tighten camera, mirror and eye, and part them from what vibrates"
    )
    return Subject("stability", measured | {"motion_hz": frequency_hz}, (Finding("unstable", sentence),))


def _motion_px(view: View) -> Floats | None:
    """Return where the scene is in every image against the first: the median over its details, (n, 2)."""
    first, *others = view.clip.consecutive
    if len(others) < MIN_IMAGES - 1:
        return None
    points = cv2.goodFeaturesToTrack(first, POINTS, QUALITY, SPACING_PX)
    if points is None or len(points) < MIN_POINTS:
        return None
    motion = [np.zeros(2)]
    for image in others:
        found, is_found, _ = cv2.calcOpticalFlowPyrLK(first, image, points, points.copy())
        moved = (found - points)[is_found.ravel() > 0].reshape(-1, 2)
        if len(moved) < MIN_POINTS:
            return None
        motion.append(np.median(moved, axis=0).astype(np.float64))
    return np.array(motion)


def _frequency_hz(moved_px: Floats, stamps_ns: "np.ndarray") -> float:
    """Return the frequency of the strongest motion."""
    interval_s = float(np.median(np.diff(stamps_ns))) / 1e9
    power = (np.abs(np.fft.rfft(moved_px - moved_px.mean(axis=0), axis=0)) ** 2).sum(axis=1)
    power[0] = 0
    return float(np.fft.rfftfreq(len(moved_px), max(interval_s, 1e-9))[int(power.argmax())])
