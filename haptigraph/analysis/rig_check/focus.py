"""Check the focus: the blur of the globe's rim, and of the needle's shaft if there is one."""

import cv2
import numpy as np

from haptigraph.analysis.rig_check.subject import Subject
from haptigraph.analysis.rig_check.view import View
from haptigraph.findings import Finding
from haptigraph.imaging import Floats, grey_of
from haptigraph.messages import Image
from haptigraph.perception.anatomy.rim import MIN_SHARPNESS, sharpness
from haptigraph.perception.needle.rectify import EyeGeometry
from haptigraph.perception.needle.tip_selection import Detection
from haptigraph.perception.needle.tracker import detections_in

__all__ = ["focus"]

MAX_BLUR_MM, MAX_BLUR_PX = 0.1, 1.5
"""Largest blur (standard deviation). The larger holds: no picture is sharper than its pixels."""
SEGMENT_MM, SEGMENTS = 0.5, 8  # of the shaft behind its tip; short, because a shaft may taper
ACROSS_MM, STEP_PX = 1.0, 0.25
MIN_SLOPE_GREY = 4.0  # grey levels per px of an edge that can be measured
SHARPEST = 25  # percentile over images: a needle that moves is blurred by its motion


def focus(view: View) -> Subject:
    """Judge the focus."""
    if view.rim is None:
        if sharpness(view.image) >= MIN_SHARPNESS:
            return Subject("focus", not_judged="no rim of an eye was found")
        finding = Finding("focus", "nothing in the picture is sharp; focus the camera on the eye's cut face")
        return Subject("focus", findings=(finding,))
    limit_mm = max(MAX_BLUR_MM, MAX_BLUR_PX / view.px_per_mm)
    blurs_mm = {"rim": view.rim.inner.blur_px / view.px_per_mm}
    if (needle_px := _needle_blur_px(view)) is not None:
        blurs_mm["needle"] = needle_px / view.px_per_mm
    findings = tuple(
        Finding(
            "focus",
            f"the {what} has a blur of {blur_mm:.2f} mm (standard deviation); at most {limit_mm:.2f} mm is "
            "valid: focus the camera on the section, or close its aperture",
        )
        for what, blur_mm in blurs_mm.items()
        if blur_mm > limit_mm
    )
    return Subject("focus", {f"{what}_blur_mm": blur_mm for what, blur_mm in blurs_mm.items()}, findings)


def _needle_blur_px(view: View) -> float | None:
    """Return the blur of the needle's edges in the sharper images; None if no needle can be measured."""
    eye = EyeGeometry(view.registration)
    found = zip(view.spread, detections_in(view.spread, view.registration), strict=True)
    blurs = [_shaft_blur_px(eye, grey_of(image), each) for image, each in found if each is not None]
    known = [blur for blur in blurs if blur is not None]
    return float(np.percentile(known, SHARPEST)) if known else None


def _shaft_blur_px(eye: EyeGeometry, grey: Image, found: Detection) -> float | None:
    """Return the median blur of the steepest edge of each segment of a shaft; None if it has no contrast."""
    across_px = np.arange(-ACROSS_MM * eye.px_per_mm, ACROSS_MM * eye.px_per_mm, STEP_PX)
    segment_px = SEGMENT_MM * eye.px_per_mm
    blurs = []
    for number in range(1, SEGMENTS + 1):
        along_px = found.tip.u_px - (number + np.arange(0, 1, 0.1)) * segment_px
        x, y = found.line.at_px(eye.trocar_px, 0.0)
        (dx, dy), (nx, ny) = found.line.direction, found.line.normal
        columns = x + along_px[:, None] * dx + across_px * nx
        rows = y + along_px[:, None] * dy + across_px * ny
        samples = cv2.remap(grey, columns.astype(np.float32), rows.astype(np.float32), cv2.INTER_LINEAR)
        slope = np.abs(np.gradient(samples.mean(axis=0, dtype=np.float64), STEP_PX))
        if slope.max() >= MIN_SLOPE_GREY:
            blurs.append(_half_width_px(slope) / 2.355)
    return float(np.median(blurs)) if len(blurs) >= SEGMENTS // 2 else None


def _half_width_px(slope: Floats) -> float:
    """Return the full width at half maximum of the highest peak."""
    is_low, peak = slope < slope.max() / 2, int(slope.argmax())
    before, after = np.flatnonzero(is_low[:peak]), np.flatnonzero(is_low[peak:])
    start = int(before[-1]) + 1 if len(before) else 0
    stop = peak + int(after[0]) if len(after) else len(slope)
    return (stop - start) * STEP_PX
