"""Say in a few lines what was found, how well, and whether the scale is plausible."""

import math
from pathlib import Path

from haptigraph.analysis.registering.overrides import Overrides, named_trocars
from haptigraph.geometry import Vec
from haptigraph.perception.anatomy.anatomy import Anatomy, FoundTrocar
from haptigraph.registration.camera import Registration
from haptigraph.registration.retarget import angle_rad
from haptigraph.registration.text import AnatomyPx, TrocarPx

__all__ = ["WALL_MM", "along_text", "in_px_and_mm", "report_lines", "rim_line", "tilt_line", "wall_mm"]

WALL_MM = (0.3, 4.0)  # plausible thickness
RIM_BY = {"needle": "by where the needle pivots", "mouths": "by the mouths of holes"}


def wall_mm(anatomy: Anatomy, mm_per_px: float) -> float:
    """Return the thickness of the wall; nan if its outer edge is not seen."""
    inner, outer = anatomy.rim.inner, anatomy.rim.outer
    return (outer.radius_px - inner.radius_px) / anatomy.rim_ratio * mm_per_px if outer else math.nan


def report_lines(
    anatomy: Anatomy,
    found: AnatomyPx,
    registration: Registration,
    overrides: Overrides,
    files: tuple[Path, Path],
) -> list[str]:
    """Return the report, line by line."""
    mm, inner, outer = registration.image.mm_per_px, anatomy.rim.inner, anatomy.rim.outer
    seen = inner.support_ratio
    lines = [
        f"globe      centre ({found.center_px[0]:.1f}, {found.center_px[1]:.1f}) px, radius "
        f"{found.radius_px:.1f} px; residual {in_px_and_mm(inner.residual_px, mm)} on {seen:.0%} of it",
        tilt_line(anatomy, mm),
        f"scale      {mm:.5f} mm/px, from a diameter of {found.diameter_mm:g} mm",
    ]
    if outer is not None:
        lines.append(
            f"check      at this scale the wall is {wall_mm(anatomy, mm):.2f} mm thick "
            f"(plausible: {WALL_MM[0]:g} to {WALL_MM[1]:g})"
        )
    else:
        lines.append("check      the wall's outer edge is not seen: make sure that the inner one was found")
    lines.append(rim_line(anatomy, mm))
    lines.append(
        f"retina     {len(found.contour_px)} points, {anatomy.refined} of them where the edge was seen"
    )
    for (name, trocar), kept in zip(named_trocars(anatomy, overrides.mirrored), found.trocars, strict=False):
        if kept.name == name:
            lines.append(_trocar_line(anatomy, trocar, kept, registration))
    default = overrides.target is None and overrides.target_mm is None
    lines.append(
        f"target     ({found.target_px[0]:.1f}, {found.target_px[1]:.1f}) px, "
        f"{along_text(registration.target.at_mm, registration.globe.radius_mm)}"
        + (" (not given: its bottom; --target or --target-mm moves it)" if default else "")
    )
    lines.append(_background_line(bool(found.background_webp)))
    return [*lines, f"written    {files[0]}\npicture    {files[1]}"]


def along_text(place_mm: Vec, radius_mm: float) -> str:
    """Say how far along the retina a place lies."""
    return f"{round(angle_rad(place_mm) * radius_mm, 2) + 0.0:+.2f} mm along the retina"  # never -0.00


def tilt_line(anatomy: Anatomy, mm_per_px: float) -> str:
    """Say how the camera looks at the globe."""
    left = f"radius varies by {in_px_and_mm(anatomy.rim.inner.out_of_round_px, mm_per_px)} either way"
    if anatomy.tilt is None:
        return f"tilt       none seen; {left}"
    right, down = (math.degrees(part) for part in anatomy.tilt.tilt_rad)
    sides = [
        name
        for name, part in (("right", right), ("left", -right), ("lower", down), ("upper", -down))
        if part > 0.35 * anatomy.tilt.angle_deg
    ]
    return (
        f"tilt       {anatomy.tilt.angle_deg:.1f} deg, the image's {' and '.join(sides)} side farther; "
        f"a homography is written; after it, {left}"
    )


def rim_line(anatomy: Anatomy, mm_per_px: float) -> str:
    """Say where the rim stands, and how uncertain that leaves globe and retina."""
    doubt = in_px_and_mm(anatomy.rim_uncertainty_px, mm_per_px)
    if anatomy.rim_by:
        by = " and ".join(RIM_BY[name] for name in anatomy.rim_by)
        larger = f"{anatomy.rim_ratio - 1:.1%} larger than the section, {by}"
        return f"rim        seen {larger}; that leaves globe and retina uncertain by {doubt}"
    return (
        "rim        taken to lie in the section; if it stands before it, globe and retina are off by "
        f"{doubt} or so: a clip with a needle that turns would tell"
    )


def _background_line(is_kept: bool) -> str:
    """Say whether the eye without needle was seen: a run may then begin with the needle in it."""
    if is_kept:
        return "empty eye  seen behind the needle, and kept: a run may begin with the needle inside"
    return (
        "empty eye  not kept, for no needle was seen to move; let runs begin with the needle out of the eye, "
        "or give a clip in which it moves"
    )


def _trocar_line(anatomy: Anatomy, trocar: FoundTrocar, kept: TrocarPx, registration: Registration) -> str:
    mm = registration.image.mm_per_px
    out_mm = math.dist(trocar.point_px, anatomy.center_px) * mm - registration.globe.radius_mm
    how = "by the hole's mouth"
    if trocar.rcm is not None:
        how = f"by {trocar.rcm.lines} shaft lines, residual {in_px_and_mm(trocar.rcm.residual_px, mm)}"
    used = ", in use" if kept.used else ""
    x, y = trocar.point_px
    return (
        f"trocar     {kept.name}{used}: ({x:.1f}, {y:.1f}) px, {out_mm:.2f} mm outside the inner edge, {how}"
    )


def in_px_and_mm(length_px: float, mm_per_px: float) -> str:
    """Return a length in both units."""
    return f"{length_px:.2f} px ({length_px * mm_per_px:.3f} mm)"
