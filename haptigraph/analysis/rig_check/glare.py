"""Check the port openings for glare, which hides where the needle enters."""

import math

import numpy as np

from haptigraph.analysis.rig_check.subject import Subject
from haptigraph.analysis.rig_check.view import View
from haptigraph.findings import Finding
from haptigraph.imaging import Floats, Mask
from haptigraph.perception.anatomy.port_opening import WHITE_GREY

__all__ = ["glare"]

MAX_WHITE_SHARE = 0.08
"""Of the surroundings of a port opening that is saturated in all colours: a spot of 0.5 mm. The shaft of an
instrument in the port does not count."""
REACH_MM, DEPTH_MM = 1.2, 0.3  # around an opening; its middle is so far inside the rim
INSIDE_RATIO = 0.99  # of the rim's radius: the wall itself may be white
SHAFT_MM = 1.6, 3.0  # from an opening, between which an instrument's shaft is white, too
MIN_SHAFT_MM, MAX_HALF_MM = 1.0, 0.6  # of it there: its length, and half its width
MARGIN_MM = 0.1  # beside the shaft


def glare(view: View) -> Subject:
    """Judge the port openings in the median image: a reflection stays where it is."""
    names = ["used", *(f"other_{number}" for number in range(1, len(view.trocars_deg)))]
    shares = {
        f"{name}_port_white_share": _white_share(view, angle_deg)
        for name, angle_deg in zip(names, view.trocars_deg, strict=True)
    }
    findings = tuple(
        Finding(
            "glare",
            f"{share:.0%} of the surroundings of the {'used' if name.startswith('used') else 'other'} port "
            f"opening is saturated; at most {MAX_WHITE_SHARE:.0%} is valid: move or diffuse the light",
        )
        for name, share in shares.items()
        if share > MAX_WHITE_SHARE
    )
    return Subject("glare", shares, findings)


def _white_share(view: View, angle_deg: float) -> float:
    """Return the share of an opening's surroundings that is white, apart from an instrument's shaft."""
    mm, radius_px = view.px_per_mm, view.found_radius_px
    height, width = view.image.shape[:2]
    to_px = np.mgrid[:height, :width][::-1] - np.array(view.found_center_px)[:, None, None]
    outwards = np.array([math.sin(math.radians(angle_deg)), -math.cos(math.radians(angle_deg))])
    away_mm = np.hypot(*(to_px - (outwards * (radius_px - DEPTH_MM * mm))[:, None, None])) / mm
    is_inside = np.hypot(*to_px) < INSIDE_RATIO * radius_px
    near = is_inside & (away_mm < REACH_MM)
    if not near.any():
        return 0.0
    is_white = is_inside & (view.image.min(axis=2) >= WHITE_GREY)
    trocar_px = (
        outwards * math.hypot(*view.registration.trocar.at_mm) * radius_px / view.registration.globe.radius_mm
    )
    beyond = is_white & (SHAFT_MM[0] < away_mm) & (away_mm < SHAFT_MM[1])
    is_shaft = _shaft((to_px - trocar_px[:, None, None]) / mm, beyond)
    return float(np.mean((is_white & ~is_shaft)[near]))


def _shaft(from_trocar_mm: Floats, is_white: Mask) -> Mask:
    """Return the straight band from the trocar, (h, w), that is white farther inside; nothing if none is.

    Args:
        from_trocar_mm: Position of each pixel, (2, h, w).
        is_white: What is white farther inside, (h, w).
    """
    nothing = np.zeros_like(is_white)
    if not is_white.any():
        return nothing
    along = from_trocar_mm[:, is_white].mean(axis=1)
    along /= np.linalg.norm(along)
    forward_mm = along[0] * from_trocar_mm[0] + along[1] * from_trocar_mm[1]
    aside_mm = np.abs(along[0] * from_trocar_mm[1] - along[1] * from_trocar_mm[0])
    half_mm = float(aside_mm[is_white].max())
    if half_mm > MAX_HALF_MM or np.ptp(forward_mm[is_white]) < MIN_SHAFT_MM:
        return nothing
    return np.asarray(aside_mm < half_mm + MARGIN_MM)
