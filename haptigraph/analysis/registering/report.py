"""The report of `register`: what was found, residuals and uncertainty, and whether the scale is plausible."""

import math
from collections.abc import Sequence
from pathlib import Path

from haptigraph.analysis.registering.depth import depth_line
from haptigraph.analysis.registering.overrides import (
    MAX_LENS_RISK_PX,
    UPRIGHT_HINT,
    Overrides,
    named_trocars,
)
from haptigraph.geometry import Vec
from haptigraph.imaging import UPRIGHT
from haptigraph.perception.anatomy.anatomy import Anatomy, FoundTrocar
from haptigraph.perception.anatomy.rcm import Rcm
from haptigraph.registration.assumed import LENS, MIRROR, RIM, SCALE, TARGET, assumed_text, needs_consent
from haptigraph.registration.camera import Registration
from haptigraph.registration.retarget import retina_angle_rad
from haptigraph.registration.text import AnatomyPx, TrocarPx

__all__ = [
    "WALL_MM",
    "along_text",
    "in_px_and_mm",
    "lens_line",
    "report_lines",
    "rim_line",
    "tilt_line",
    "trocar_evidence",
    "upright_line",
    "wall_mm",
]

WALL_MM = (0.3, 4.0)
"""Plausible thickness of the globe's wall."""
STATED_BY = {
    TARGET: "--target or --target-mm",
    SCALE: "--diameter-mm",
    MIRROR: "--[not-]mirrored",
    LENS: "--lens",
}
RIM_EVIDENCE = {
    "design": "the design",
    "needle": "the needle's remote centre of motion",
    "port_openings": "the port openings",
}


def wall_mm(anatomy: Anatomy, mm_per_px: float) -> float:
    """Return the thickness of the wall; nan if its outer edge was not found."""
    inner, outer = anatomy.rim.inner, anatomy.rim.outer
    return (outer.radius_px - inner.radius_px) / anatomy.rim_ratio * mm_per_px if outer else math.nan


def report_lines(
    anatomy: Anatomy,
    found: AnatomyPx,
    registration: Registration,
    overrides: Overrides,
    files: tuple[Path, Path],
    about_position: Sequence[str] = (),
) -> list[str]:
    """Return the report, line by line; `about_position` are those about its rotation and a rig's design."""
    mm, inner, outer = registration.image.mm_per_px, anatomy.rim.inner, anatomy.rim.outer
    support = inner.support_ratio
    lines = [
        f"globe      centre ({found.center_px[0]:.1f}, {found.center_px[1]:.1f}) px, radius "
        f"{found.radius_px:.1f} px; residual {in_px_and_mm(inner.residual_px, mm)} on {support:.0%} of it",
        tilt_line(anatomy, mm),
        lens_line(anatomy, mm),
        f"scale      {mm:.5f} mm/px, from a diameter of {found.diameter_mm:g} mm",
    ]
    if outer is not None:
        lines.append(
            f"check      at this scale the wall is {wall_mm(anatomy, mm):.2f} mm thick "
            f"(plausible: {WALL_MM[0]:g} to {WALL_MM[1]:g})"
        )
    else:
        lines.append("check      the wall's outer edge was not found: verify that the inner one was")
    lines.append(rim_line(anatomy, mm))
    lines.append(
        f"retina     {len(found.contour_px)} points, {anatomy.measured_points} of them measured at the edge"
    )
    for (name, trocar), written in zip(
        named_trocars(anatomy, overrides.is_mirrored), found.trocars, strict=False
    ):
        if written.name == name:
            lines.append(_trocar_line(anatomy, trocar, written, registration))
    lines.append(
        f"target     ({found.target_px[0]:.1f}, {found.target_px[1]:.1f}) px, "
        f"{along_text(registration.target.at_mm, registration.globe.radius_mm)}"
        + (" (assumed: its lowest point)" if TARGET in found.assumed else "")
    )
    if found.depth is not None:
        lines.append(depth_line(found.depth, mm))
    lines.append(_background_line(bool(found.background_webp)))
    if found.turn != UPRIGHT:
        lines.append(f"turned     by {found.turn}; a run needs the same settings")
    lines += [*about_position, *_assumed_lines(found.assumed)]
    return [*lines, f"written    {files[0]}\npicture    {files[1]}"]


def along_text(point_mm: Vec, radius_mm: float) -> str:
    """Describe the position of a point along the retina."""
    return f"{round(retina_angle_rad(point_mm) * radius_mm, 2) + 0.0:+.2f} mm along the retina"  # never -0.00


def tilt_line(anatomy: Anatomy, mm_per_px: float) -> str:
    """Describe the camera's tilt."""
    out_of_round = f"radius varies by {in_px_and_mm(anatomy.rim.inner.out_of_round_px, mm_per_px)} either way"
    if anatomy.tilt is None:
        return f"tilt       none measurable; {out_of_round}"
    right, down = (math.degrees(part) for part in anatomy.tilt.tilt_rad)
    sides = [
        name
        for name, part in (("right", right), ("left", -right), ("lower", down), ("upper", -down))
        if part > 0.35 * anatomy.tilt.angle_deg
    ]
    return (
        f"tilt       {anatomy.tilt.angle_deg:.1f} deg, the image's {' and '.join(sides)} side farther; "
        f"a homography is written; after correction, {out_of_round}"
    )


def lens_line(anatomy: Anatomy, mm_per_px: float) -> str:
    """Describe the lens, or how far one that nobody calibrated may put points off."""
    if (lens := anatomy.lens) is not None:
        sd = "not stated" if lens.sd_px is None else in_px_and_mm(lens.sd_px, mm_per_px)
        return f"lens       corrected as calibrated; uncertainty of corrected points: {sd}"
    risk_px = anatomy.lens_risk_px or 0.0
    more = "; calibrate it: haptigraph calibrate camera" if risk_px > MAX_LENS_RISK_PX else ""
    return (
        f"lens       {'NOT CALIBRATED' if more else 'not calibrated'}; its distortion may put points off by "
        f"{in_px_and_mm(risk_px, mm_per_px)}{more}"
    )


def rim_line(anatomy: Anatomy, mm_per_px: float) -> str:
    """Describe the position of the rim, and the uncertainty of globe and retina due to it."""
    uncertainty = in_px_and_mm(anatomy.rim_uncertainty_px, mm_per_px)
    if anatomy.rim_evidence:
        evidence = " and ".join(RIM_EVIDENCE[name] for name in anatomy.rim_evidence)
        return (
            f"rim        {anatomy.rim_ratio - 1:.1%} larger in the picture than in the needle's plane, by "
            f"{evidence}; globe and retina are uncertain by {uncertainty}"
        )
    return (
        "rim        assumed in the section; if it is in front of it, globe and retina are off by about "
        f"{uncertainty}: a clip with a needle that turns resolves this"
    )


def upright_line(anatomy: Anatomy, *, enters_above: bool | None) -> str:
    """Say by what the image is known to be upright, and where the trocars are in it.

    Args:
        anatomy: What was found.
        enters_above: Whether the needle does; None: no needle moves beside the eye.
    """
    angles = [
        f"{abs(each.angle_deg):.0f} deg to the {'right' if each.angle_deg > 0 else 'left'}"
        for each in anatomy.trocars
    ]
    where = f"; trocars found {' and '.join(angles)} of the image's top" if angles else ""
    if enters_above:
        return f"upright    the needle enters from above{where}"
    known = "DOUBTFUL: what moves beside the eye does not enter from above"
    if enters_above is None:
        known = "not verified, because no needle moves beside the eye"
    return f"upright    {known}{where}; look at the picture: {UPRIGHT_HINT}"


def _background_line(has_background: bool) -> str:
    """Say whether the file has a reference image without instrument."""
    if has_background:
        return "reference  image without instrument stored: a run may begin with the needle inside"
    return (
        "reference  image without instrument not stored, because no needle moves; begin runs with the needle "
        "outside the eye, or register a clip in which it moves"
    )


def _assumed_lines(assumed: Sequence[str]) -> list[str]:
    """Say what was assumed, and by which options to state it."""
    if not assumed:
        return []
    stated = [name for name in assumed if name in STATED_BY]
    lines = []
    if stated:
        options = ", ".join(STATED_BY[name] for name in stated)
        lines.append(
            f"ASSUMED    {assumed_text(stated)}; state {'it' if len(stated) == 1 else 'them'} with {options}"
        )
    if RIM in assumed:
        lines.append(
            f"ASSUMED    {assumed_text([RIM])}; images with a moving needle, a port opening, or --rig show it"
        )
    if needs_consent(assumed):
        lines.append("           a run stays silent until the target is stated, or with --accept-assumed")
    return lines


def trocar_evidence(rcm: Rcm | None, mm_per_px: float, *, is_designed: bool = False) -> str:
    """Describe what a trocar was found by."""
    if is_designed:
        return "the design: no picture shows it"
    if rcm is None:
        return "its port opening"
    return f"{rcm.lines} shaft lines, residual {in_px_and_mm(rcm.residual_px, mm_per_px)}"


def _trocar_line(anatomy: Anatomy, trocar: FoundTrocar, written: TrocarPx, registration: Registration) -> str:
    mm = registration.image.mm_per_px
    outside_mm = math.dist(trocar.point_px, anatomy.center_px) * mm - registration.globe.radius_mm
    used = ", in use" if written.used else ""
    x, y = trocar.point_px
    along = ""
    if trocar.angle_sd_deg is not None:
        sd_px = math.radians(trocar.angle_sd_deg) * math.dist(trocar.point_px, anatomy.center_px)
        along = f", uncertain by {in_px_and_mm(sd_px, mm)} along the wall"
    return (
        f"trocar     {written.name}{used}: ({x:.1f}, {y:.1f}) px, {outside_mm:.2f} mm outside the inner "
        f"edge, from {trocar_evidence(trocar.rcm, mm, is_designed=trocar.is_designed)}{along}"
    )


def in_px_and_mm(length_px: float, mm_per_px: float) -> str:
    """Return a length in both units."""
    return f"{length_px:.2f} px ({length_px * mm_per_px:.3f} mm)"
