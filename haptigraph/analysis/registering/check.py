"""Say how well a draft of a registration fits the picture, in px and mm, and whether a run would take it.

A draft in, figures and sentences out. What was seen in the picture does not change while somebody drags: it
is compared anew. Knows neither files nor pages.
"""

import math
from collections.abc import Callable, Sequence

import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from haptigraph.analysis.registering.draft import Draft, Opened, data_of, sound_registration
from haptigraph.analysis.registering.overrides import SNAP_MM
from haptigraph.analysis.registering.report import (
    WALL_MM,
    along_text,
    in_px_and_mm,
    rim_line,
    tilt_line,
    wall_mm,
)
from haptigraph.errors import BadInput
from haptigraph.geometry import ImageGeometry, Polyline, Vec, distance_to_polyline, nearest_on_polyline, norm
from haptigraph.imaging import Floats
from haptigraph.perception.anatomy.anatomy import Anatomy
from haptigraph.perception.anatomy.rcm import Rcm
from haptigraph.registration.retarget import angle_rad

__all__ = ["Checked", "Row", "check_draft"]

OUTLINE_STEPS = 120
EVERY = 3  # of the places where the edge was seen, for the retina


class Row(Struct, frozen=True):
    """One thing and how well it fits."""

    what: str
    where: str
    off_px: float | None = None
    """RMS distance of the picture's edge from it, or its distance from where it was found or belongs."""
    off_mm: float | None = None
    note: str = ""
    is_plausible: bool = True


class Checked(Struct, frozen=True):
    """What there is to know about a draft."""

    problem: str
    """Why a run would refuse it; empty: it would not."""
    mm_per_px: float
    rows: tuple[Row, ...]
    outline_px: tuple[Vec, ...]
    """The globe's inner circle as the camera sees it."""
    target_on_retina_px: Vec | None
    """The place on the retina nearest to the target, if that is near."""


def check_draft(opened: Opened, draft: Draft) -> Checked:
    """Compare a draft with what was seen.

    Raises:
        BadInput: If a place lies far outside the image.
    """
    tilt = data_of(opened, draft).frontal_from_image
    image = ImageGeometry(
        center_px=tilt(draft.center_px) if tilt else draft.center_px,
        mm_per_px=draft.diameter_mm / (2 * draft.radius_px),
        mirrored=draft.mirrored,
        frontal_from_image=tilt,
    )
    try:
        sound_registration(replace(opened, background_webp=b""), draft)  # told at every drag: not read anew
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
    seen_mm = _edge_mm(anatomy, image) if anatomy else None
    return [
        _globe(anatomy, draft, image, seen_mm),
        _scale(anatomy, draft, image),
        *([_told(anatomy, image, rim_line)] if anatomy else []),
        _retina(anatomy, image, retina, seen_mm),
        _target(draft, image, retina),
        *(_trocar(anatomy, draft, image, number) for number in range(len(draft.trocars))),
        *([_told(anatomy, image, tilt_line)] if anatomy else []),
    ]


def _edge_mm(anatomy: Anatomy, image: ImageGeometry) -> Floats:
    """Return where the rim was seen, moved into the section's plane, in the draft's eye frame, (n, 2)."""
    edge = anatomy.rim.inner
    radii = (edge.radii_px(edge.angles) + edge.offsets_px) / anatomy.rim_ratio
    right = anatomy.center_px[0] + radii * np.sin(edge.angles)
    down = anatomy.center_px[1] + radii * np.cos(edge.angles)
    places: list[Vec] = list(zip(right.tolist(), down.tolist(), strict=True))
    if anatomy.tilt is not None:
        places = list(map(anatomy.tilt.image_from_frontal, places))
    return np.array([image.to_mm(place) for place in places])


def _globe(anatomy: Anatomy | None, draft: Draft, image: ImageGeometry, seen_mm: Floats | None) -> Row:
    x, y = draft.center_px
    where = f"centre ({x:.1f}, {y:.1f}) px, radius {draft.radius_px:.1f} px"
    if anatomy is None or seen_mm is None:
        return Row("Globe", where, note="no edge was found to compare with")
    off_mm = _rms(np.hypot(seen_mm[:, 0], seen_mm[:, 1]) - draft.diameter_mm / 2)
    return _row(
        "Globe", where, off_mm, image, f"RMS of the edge seen on {anatomy.rim.inner.support_ratio:.0%} of it"
    )


def _retina(anatomy: Anatomy | None, image: ImageGeometry, retina: Polyline, seen_mm: Floats | None) -> Row:
    where = f"{len(retina.points_mm)} points"
    if anatomy is None or seen_mm is None:
        return Row("Retina", where, note="no edge was found to compare with")
    angles = np.arctan2(seen_mm[:, 0], -seen_mm[:, 1])
    low, high = sorted(angle_rad(place_mm) for place_mm in (retina.points_mm[0], retina.points_mm[-1]))
    beside = seen_mm[(low < angles) & (angles < high)][::EVERY]
    if not len(beside):
        return Row("Retina", where, note="no edge was seen along it")
    off_mm = _rms([distance_to_polyline((float(x), float(y)), retina) for x, y in beside])
    return _row("Retina", where, off_mm, image, "RMS of the edge seen along it")


def _trocar(anatomy: Anatomy | None, draft: Draft, image: ImageGeometry, number: int) -> Row:
    trocar = draft.trocars[number]
    what = f"Trocar {trocar.name}{', in use' if trocar.used else ''}"
    out_mm = norm(image.to_mm(trocar.point_px)) - draft.diameter_mm / 2
    where = f"{abs(out_mm):.2f} mm {'outside' if out_mm >= 0 else 'inside'} the inner edge"
    if anatomy is None or not anatomy.trocars:
        return Row(what, where, note="placed by hand")
    at_px = anatomy.frontal_px(trocar.point_px)
    found = min(anatomy.trocars, key=lambda each: math.dist(each.point_px, at_px))
    off_mm = math.dist(found.point_px, at_px) * image.mm_per_px
    return _row(what, where, off_mm, image, _how(found.rcm, image.mm_per_px))


def _how(rcm: Rcm | None, mm_per_px: float) -> str:
    if rcm is None:
        return "from its hole's mouth"
    left = in_px_and_mm(rcm.residual_px, mm_per_px)
    return f"from the pivot of {rcm.lines} shaft lines, which miss it by {left}"


def _target(draft: Draft, image: ImageGeometry, retina: Polyline) -> Row:
    place_mm = image.to_mm(draft.target_px)
    where = f"{along_text(place_mm, draft.diameter_mm / 2)} from its bottom"
    return _row("Target", where, distance_to_polyline(place_mm, retina), image, "off the retina")


def _scale(anatomy: Anatomy | None, draft: Draft, image: ImageGeometry) -> Row:
    where = f"{image.mm_per_px:.5f} mm/px, from a diameter of {draft.diameter_mm:g} mm"
    if anatomy is None or anatomy.rim.outer is None:
        return Row(
            "Scale", where, note="no wall seen to check it by: make sure that the inner edge is marked"
        )
    thick_mm, (low, high) = wall_mm(anatomy, image.mm_per_px), WALL_MM
    note = f"at this scale the wall is {thick_mm:.2f} mm thick (plausible: {low:g} to {high:g})"
    return Row("Scale", where, note=note, is_plausible=low <= thick_mm <= high)


def _told(anatomy: Anatomy, image: ImageGeometry, line: Callable[[Anatomy, float], str]) -> Row:
    """Return what `register` says: a word, and behind it a sentence."""
    word, _, said = line(anatomy, image.mm_per_px).partition(" ")
    return Row(word.capitalize(), "", note=said.strip())


def _row(what: str, where: str, off_mm: float, image: ImageGeometry, note: str = "") -> Row:
    return Row(what, where, off_mm / image.mm_per_px, off_mm, note)


def _rms(offs_mm: "Floats | Sequence[float]") -> float:
    return float(np.sqrt(np.mean(np.square(offs_mm))))
