"""Measure how well a draft of a registration fits the image, in px and mm, and whether a run would accept it.

Compares a draft, while somebody drags it, with the edges and RCMs that were measured once in the images.
"""

import math
from collections.abc import Callable, Sequence

import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from haptigraph.analysis.registering.draft import Draft, OpenedSource, anatomy_px_of, checked_registration
from haptigraph.analysis.registering.overrides import SNAP_MM
from haptigraph.analysis.registering.report import (
    WALL_MM,
    along_text,
    lens_line,
    rim_line,
    tilt_line,
    trocar_evidence,
    wall_mm,
)
from haptigraph.errors import BadInput
from haptigraph.geometry import Polyline, Vec, distance_to_polyline, nearest_on_polyline, norm
from haptigraph.imaging import Floats
from haptigraph.perception.anatomy.anatomy import Anatomy
from haptigraph.projection import ImageGeometry
from haptigraph.registration.assumed import TARGET, TROCAR
from haptigraph.registration.retarget import retina_angle_rad

__all__ = ["Checked", "Row", "check_draft"]

OUTLINE_STEPS = 120
EVERY = 3  # the retina is compared with every third edge point


class Row(Struct, frozen=True):
    """How well one part of a draft fits. The page reads it as JSON."""

    what: str
    where: str
    off_px: float | None = None
    """RMS distance of the measured edge from it, or its distance from where it was found or belongs."""
    off_mm: float | None = None
    note: str = ""
    is_plausible: bool = True


class Checked(Struct, frozen=True):
    """The result of checking a draft."""

    problem: str
    """Why a run would refuse it; empty if it would not."""
    mm_per_px: float
    rows: tuple[Row, ...]
    outline_px: tuple[Vec, ...]
    """The globe's inner circle in the image as stored."""
    target_on_retina_px: Vec | None
    """The point on the retina nearest to the target; None if it is too far away."""


def check_draft(opened: OpenedSource, draft: Draft) -> Checked:
    """Compare a draft with the measurements in the images.

    Raises:
        BadInput: If a point is far outside the image.
    """
    frontal = anatomy_px_of(opened, draft).frontal_map
    image = ImageGeometry(
        center_px=frontal(draft.center_px) if frontal else draft.center_px,
        mm_per_px=draft.diameter_mm / (2 * draft.radius_px),
        mirrored=draft.mirrored,
        frontal_from_image=frontal,
    )
    try:  # without the background image, which would be decoded at every drag
        checked_registration(replace(opened, background_webp=b""), draft)
        problem = ""
    except BadInput as error:
        problem = error.problem
    retina = Polyline(tuple(image.to_mm(point) for point in draft.contour_px))
    target_mm = image.to_mm(draft.target_px)
    nearest_mm = nearest_on_polyline(target_mm, retina)
    turns = [2 * math.pi * step / OUTLINE_STEPS for step in range(OUTLINE_STEPS)]
    radius_mm = draft.diameter_mm / 2
    return Checked(
        problem=problem,
        mm_per_px=image.mm_per_px,
        rows=tuple(_rows(opened.anatomy, draft, image, retina)),
        outline_px=tuple(image.to_px((radius_mm * math.sin(t), -radius_mm * math.cos(t))) for t in turns),
        target_on_retina_px=image.to_px(nearest_mm) if math.dist(nearest_mm, target_mm) <= SNAP_MM else None,
    )


def _rows(anatomy: Anatomy | None, draft: Draft, image: ImageGeometry, retina: Polyline) -> list[Row]:
    edge_mm = _edge_mm(anatomy, image) if anatomy else None
    return [
        _globe(anatomy, draft, image, edge_mm),
        _scale(anatomy, draft, image),
        *([_report_row(anatomy, image, rim_line)] if anatomy else []),
        _retina(anatomy, image, retina, edge_mm),
        _target(draft, image, retina),
        *(_trocar(anatomy, draft, image, number) for number in range(len(draft.trocars))),
        *(
            [_report_row(anatomy, image, tilt_line), _report_row(anatomy, image, lens_line)]
            if anatomy
            else []
        ),
    ]


def _edge_mm(anatomy: Anatomy, image: ImageGeometry) -> Floats:
    """Return the measured points of the rim in the section's plane, in the draft's eye frame, (n, 2)."""
    edge = anatomy.rim.inner
    radii = (edge.radii_px(edge.angles) + edge.offsets_px) / anatomy.rim_ratio
    right = anatomy.center_px[0] + radii * np.sin(edge.angles)
    down = anatomy.center_px[1] + radii * np.cos(edge.angles)
    points: list[Vec] = list(zip(right.tolist(), down.tolist(), strict=True))
    return np.array([image.to_mm(anatomy.image_px(point)) for point in points])


def _globe(anatomy: Anatomy | None, draft: Draft, image: ImageGeometry, edge_mm: Floats | None) -> Row:
    x, y = draft.center_px
    where = f"centre ({x:.1f}, {y:.1f}) px, radius {draft.radius_px:.1f} px"
    if anatomy is None or edge_mm is None:
        return Row("Globe", where, note="no edge was found to compare with")
    off_mm = _rms(np.hypot(edge_mm[:, 0], edge_mm[:, 1]) - draft.diameter_mm / 2)
    support = anatomy.rim.inner.support_ratio
    return _row("Globe", where, off_mm, image, f"RMS of the edge, which was found on {support:.0%} of it")


def _retina(anatomy: Anatomy | None, image: ImageGeometry, retina: Polyline, edge_mm: Floats | None) -> Row:
    where = f"{len(retina.points_mm)} points"
    if anatomy is None or edge_mm is None:
        return Row("Retina", where, note="no edge was found to compare with")
    angles = np.arctan2(edge_mm[:, 0], -edge_mm[:, 1])
    low, high = sorted(retina_angle_rad(point_mm) for point_mm in (retina.points_mm[0], retina.points_mm[-1]))
    nearby = edge_mm[(low < angles) & (angles < high)][::EVERY]
    if not len(nearby):
        return Row("Retina", where, note="no edge was found along it")
    off_mm = _rms([distance_to_polyline((float(x), float(y)), retina) for x, y in nearby])
    return _row("Retina", where, off_mm, image, "RMS of the edge along it")


def _trocar(anatomy: Anatomy | None, draft: Draft, image: ImageGeometry, number: int) -> Row:
    trocar = draft.trocars[number]
    what = f"Trocar {trocar.name}{', in use' if trocar.used else ''}"
    outside_mm = norm(image.to_mm(trocar.point_px)) - draft.diameter_mm / 2
    where = f"{abs(outside_mm):.2f} mm {'outside' if outside_mm >= 0 else 'inside'} the inner edge"
    if anatomy is None or not anatomy.trocars:
        if TROCAR in draft.assumed:
            note = "assumed, not measured: drag it to the needle's remote centre of motion"
            return Row(what, where, note=note, is_plausible=False)
        return Row(what, where, note="placed by hand")
    point_px = anatomy.frontal_px(trocar.point_px)
    found = min(anatomy.trocars, key=lambda each: math.dist(each.point_px, point_px))
    off_mm = math.dist(found.point_px, point_px) * image.mm_per_px
    return _row(what, where, off_mm, image, f"from {trocar_evidence(found.rcm, image.mm_per_px)}")


def _target(draft: Draft, image: ImageGeometry, retina: Polyline) -> Row:
    point_mm = image.to_mm(draft.target_px)
    where = f"{along_text(point_mm, draft.diameter_mm / 2)} from its bottom"
    if TARGET in draft.assumed:  # its distance from the retina would look like a measurement
        note = "assumed, not measured: click it if it is right, or drag it"
        return Row("Target", where, note=note, is_plausible=False)
    return _row("Target", where, distance_to_polyline(point_mm, retina), image, "off the retina")


def _scale(anatomy: Anatomy | None, draft: Draft, image: ImageGeometry) -> Row:
    where = f"{image.mm_per_px:.5f} mm/px, from a diameter of {draft.diameter_mm:g} mm"
    if anatomy is None or anatomy.rim.outer is None:
        return Row(
            "Scale", where, note="not checked: no wall was found; verify that the inner edge is marked"
        )
    thickness_mm, (low, high) = wall_mm(anatomy, image.mm_per_px), WALL_MM
    note = f"at this scale the wall is {thickness_mm:.2f} mm thick (plausible: {low:g} to {high:g})"
    return Row("Scale", where, note=note, is_plausible=low <= thickness_mm <= high)


def _report_row(anatomy: Anatomy, image: ImageGeometry, line: Callable[[Anatomy, float], str]) -> Row:
    """Return a line of `register`'s report: its heading and its text."""
    heading, _, text = line(anatomy, image.mm_per_px).partition(" ")
    return Row(heading.capitalize(), "", note=text.strip())


def _row(what: str, where: str, off_mm: float, image: ImageGeometry, note: str = "") -> Row:
    return Row(what, where, off_mm / image.mm_per_px, off_mm, note)


def _rms(values_mm: "Floats | Sequence[float]") -> float:
    return float(np.sqrt(np.mean(np.square(values_mm))))
