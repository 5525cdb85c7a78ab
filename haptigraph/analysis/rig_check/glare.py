"""Check the port openings for glare, which hides where the needle enters."""

import math

import numpy as np

from haptigraph.analysis.rig_check.subject import Subject
from haptigraph.analysis.rig_check.view import View
from haptigraph.findings import Finding
from haptigraph.perception.anatomy.port_opening import WHITE_GREY

__all__ = ["glare"]

MAX_WHITE_SHARE = 0.08
"""Of the surroundings of a port opening that is saturated in all colours: a spot of 0.5 mm. An instrument in
the port may have highlights, but smaller ones."""
REACH_MM, DEPTH_MM = 1.2, 0.3  # around an opening; its middle is so far inside the rim
INSIDE_RATIO = 0.99  # of the rim's radius: the wall itself may be white


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
    (center_x, center_y), radius_px = view.found_center_px, view.found_radius_px
    angle, at_px = math.radians(angle_deg), radius_px - DEPTH_MM * view.px_per_mm
    x, y = center_x + at_px * math.sin(angle), center_y - at_px * math.cos(angle)
    rows, columns = np.ogrid[: view.image.shape[0], : view.image.shape[1]]
    near = np.hypot(columns - x, rows - y) < REACH_MM * view.px_per_mm
    near &= np.hypot(columns - center_x, rows - center_y) < INSIDE_RATIO * radius_px
    return float(np.mean(view.image[near].min(axis=1) >= WHITE_GREY)) if near.any() else 0.0
