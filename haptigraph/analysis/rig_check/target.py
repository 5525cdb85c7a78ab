"""Check the target: a mark on the retina, such as the rig's exchangeable plug, against the registered target.

A mark is a stretch of the retina, about as wide as a target, that differs in colour from the retina on either
side, just inside the rim or on the cut face.
"""

import math

import cv2
import numpy as np
from msgspec import Struct
from scipy.ndimage import median_filter

from haptigraph.analysis.rig_check.subject import Subject
from haptigraph.analysis.rig_check.view import View, angle_from_top_deg, wrapped_deg
from haptigraph.findings import Finding
from haptigraph.imaging import Floats
from haptigraph.perception.anatomy.port_opening import WHITE_GREY
from haptigraph.registration.assumed import TARGET
from haptigraph.rig.description import Rig

__all__ = ["Mark", "found_mark", "registered_deg", "target"]

MAX_OFF_MM = 0.35
"""Half the distance at which a tip touches the target."""
BANDS_MM = (-0.8, -0.15), (0.15, 1.0)  # from the rim outwards: on the retina, and on the cut face
HIGHLIGHT_MM = 0.6  # farther inside: a specular highlight there is no mark, nor is its edge
STEP_DEG, RADIUS_STEP_MM = 0.25, 0.1
HALF_DEG = 75.0  # from the bottom
AROUND_DEG = 14.0  # either side, with which a place is compared
WIDTH_MM = 0.5, 3.0  # of a mark
MIN_CONTRAST_GREY, MIN_CONTRAST_RATIO = 9.0, 6.0  # of a mark; the ratio is to the typical contrast
MIN_CONTRAST_SHARE = 0.12  # of the brightness around it: uneven light and texture change that by less
MAX_RIVAL = 0.6  # contrast of the second strongest mark against the strongest: none is certain otherwise
RIG_MARGIN_SD = 3.0


class Mark(Struct, frozen=True):
    """A mark on the retina."""

    angle_deg: float
    """From the bottom of the picture, positive to its right."""
    sd_deg: float


def target(view: View, rig: Rig | None) -> Subject:
    """Judge whether the registered target is where the mark is, and where the rig has it."""
    at_deg, mm_per_deg = registered_deg(view), math.radians(view.registration.globe.radius_mm)
    measured, findings = {}, []
    mark = found_mark(view)
    if mark is not None:
        off_mm = (at_deg - mark.angle_deg) * mm_per_deg
        measured = {"target_off_mm": abs(off_mm), "target_off_sd_mm": mark.sd_deg * mm_per_deg}
        if abs(off_mm) > MAX_OFF_MM + 2 * mark.sd_deg * mm_per_deg:
            findings.append(
                Finding(
                    "target_off",
                    f"the registered target is {abs(off_mm):.2f} mm off the mark on the retina (standard "
                    f"deviation {mark.sd_deg * mm_per_deg:.2f} mm); at most {MAX_OFF_MM:g} mm is valid: "
                    "register again with --target on the mark",
                )
            )
    if rig is not None:
        by_rig_deg = -rig.eye.target_deg if view.registration.image.mirrored else rig.eye.target_deg
        off_mm = (at_deg - by_rig_deg) * mm_per_deg
        limit_mm = MAX_OFF_MM + RIG_MARGIN_SD * rig.tolerances.print_mm
        measured["target_off_rig_mm"] = abs(off_mm)
        if abs(off_mm) > limit_mm:
            findings.append(
                Finding(
                    "target_off",
                    f"the registered target is {abs(off_mm):.2f} mm from where the rig has it; at most "
                    f"{limit_mm:.2f} mm is valid: register again, or correct eye.target_deg in rig.toml",
                )
            )
    return Subject("target", measured, tuple(findings), _not_judged(view, mark, rig))


def _not_judged(view: View, mark: Mark | None, rig: Rig | None) -> str:
    if TARGET in view.registration.assumed and mark is None:
        return "the registration assumes the target, and no mark is visible that would show it"
    if mark is None and rig is None:
        return "no single mark is visible on the retina, and there is no --rig that says where the target is"
    return ""


def registered_deg(view: View) -> float:
    """Return the registered target's angle, from the bottom of the picture, positive to its right."""
    at_px = view.registration.image.to_px(view.registration.target.at_mm)
    return wrapped_deg(180 - angle_from_top_deg(at_px, view.center_px))


def found_mark(view: View) -> Mark | None:
    """Find the one mark on the retina; None if there is none, or more than one."""
    if view.rim is None:
        return None
    marks = [_mark(view, band_mm) for band_mm in BANDS_MM]
    known = [mark for mark in marks if mark is not None]
    if len(known) == 2 and abs(known[0].angle_deg - known[1].angle_deg) > 2 * (
        known[0].sd_deg + known[1].sd_deg
    ):
        return None
    return min(known, key=lambda mark: mark.sd_deg, default=None)


def _mark(view: View, band_mm: tuple[float, float]) -> Mark | None:
    """Find the mark within a band of radii."""
    mm_per_deg = math.radians(view.registration.globe.radius_mm)
    reach_deg = HALF_DEG + AROUND_DEG
    angles_deg = np.arange(-reach_deg, reach_deg + STEP_DEG / 2, STEP_DEG)
    low_mm, high_mm = band_mm
    radii_mm = np.arange(low_mm - HIGHLIGHT_MM, high_mm + RADIUS_STEP_MM, RADIUS_STEP_MM)
    samples = view.samples_at_deg(180 - angles_deg, view.found_radius_px + radii_mm * view.px_per_mm)
    tone = samples[:, radii_mm > low_mm - RADIUS_STEP_MM / 2].mean(axis=1)
    around = median_filter(tone, (2 * round(AROUND_DEG / STEP_DEG) + 1, 1), mode="nearest")
    contrast = _rms(np.asarray(cv2.blur(tone - around, (1, 5)), np.float64))
    contrast[np.abs(angles_deg) > HALF_DEG] = 0
    peak = int(contrast.argmax())
    typical, brightness = float(np.median(contrast)), float(_rms(around)[peak])
    least = max(MIN_CONTRAST_GREY, MIN_CONTRAST_RATIO * typical, MIN_CONTRAST_SHARE * brightness)
    is_highlight = tone[peak].sum() > around[peak].sum() and samples[peak].min(axis=1).max() >= WHITE_GREY
    if contrast[peak] < least or is_highlight:
        return None
    is_low = contrast < contrast[peak] / 2
    before, after = np.flatnonzero(is_low[:peak]), np.flatnonzero(is_low[peak:])
    if not len(before) or not len(after):
        return None
    start_deg, stop_deg = angles_deg[before[-1]], angles_deg[peak + after[0]]
    width_deg = float(stop_deg - start_deg)
    if not WIDTH_MM[0] <= width_deg * mm_per_deg <= WIDTH_MM[1]:
        return None
    elsewhere = np.abs(angles_deg - (start_deg + stop_deg) / 2) > width_deg
    if contrast[elsewhere].max() > MAX_RIVAL * contrast[peak]:
        return None
    sd_deg = max(width_deg / 12, STEP_DEG)
    return Mark(float(start_deg + stop_deg) / 2, sd_deg)


def _rms(color: Floats) -> Floats:
    """Return the root mean square of three colours, (n,)."""
    return np.asarray(np.sqrt(np.mean(color**2, axis=1)), np.float64)
