"""From what was seen in one B-scan to an observation, whoever saw it.

Turns surfaces and a shaft (px) into where things are (eye frame, mm). A surface is reported from where it was
first seen to where it was last seen, and on to below the tip, which the needle's own shadow hides;
`interpolated` says which parts of it were not seen themselves. Between both lie the layer that is aimed at
and the subretinal space. Knows no image.
"""

import math
from typing import NamedTuple

import numpy as np

from haptigraph.geometry import Geometry, Point, Polyline, Segment, Vec
from haptigraph.imaging import Floats, Mask
from haptigraph.messages import Certainty, Observation
from haptigraph.perception.oct.needle import row_at
from haptigraph.registration.oct import ScanRegistration

__all__ = ["ENTITIES", "Layers", "ScanPlaces", "Shaft", "casts_shadow"]

ENTITIES = frozenset(("ilm", "rpe", "subretinal_space", "target_layer", "needle_tip", "needle_line"))
"""What may be reported; `retina_surface`, which is reported too, others have registered."""
SUBRETINAL_SHARE = 0.9  # of the way from ILM to RPE: there the outer segments end, and the space can open
BESIDE_TIP_PX = 8.0  # a surface is continued so far beyond the tip
FURTHEST_PX = 60.0  # and at most so far beyond where it was seen
MARGIN_PX = 14.0  # beside the tip and below the shaft, where the shadow's edge is soft
TISSUE_IN_SHADOW = 0.08  # share of all columns: more, and it is no shadow


class Layers(NamedTuple):
    """Both surfaces, by column; rows where one was not seen mean nothing."""

    x_px: Floats
    """Where the columns are, rising, (n,)."""
    ilm_px: Floats
    ilm_seen: Mask
    rpe_px: Floats
    rpe_seen: Mask


class Shaft(NamedTuple):
    """A needle in the image."""

    tip_px: Vec
    start_px: Vec
    """Where its line enters the image, or is first seen."""
    along_px: Vec
    """Direction, length 1; it points down."""
    sd_px: Vec
    """Of the tip: across the image and down it."""
    angle_sd_deg: float
    """In the image, whose pixels are not square."""
    confidence: float


def casts_shadow(shaft: Shaft, layers: Layers) -> bool:
    """Tell whether no tissue is seen where a needle would hide it; a ghost hides nothing."""
    (x, y), (dx, dy) = shaft.tip_px, shaft.along_px
    behind = math.copysign(1.0, dx) * (x - layers.x_px) > MARGIN_PX
    shaft_y = y + dy / dx * (layers.x_px - x) if dx else np.full_like(layers.x_px, -math.inf)
    seen = layers.ilm_seen & behind & (layers.ilm_px > shaft_y + MARGIN_PX)
    return float(seen.mean()) <= TISSUE_IN_SHADOW


class _Course(NamedTuple):
    """One surface, ready to be told."""

    x_px: Floats
    row_px: Floats
    is_seen: Mask


class ScanPlaces:
    """Say in millimetres what was seen.

    Args:
        registration: Size and scale of the B-scans, and how deep the target lies.
    """

    def __init__(self, registration: ScanRegistration) -> None:
        self._registration = registration
        self._axial_mm = registration.image.axial_mm_per_px or registration.image.mm_per_px

    def __call__(self, stamp_ns: int, layers: Layers, shaft: Shaft | None) -> Observation:
        """Return the observation of one B-scan."""
        found, interpolated = self._layers(layers, shaft)
        if shaft is None:
            return Observation(stamp_ns, found, interpolated=interpolated)
        found |= self._needle(shaft)
        return Observation(stamp_ns, found, certainty=self._certainty(shaft), interpolated=interpolated)

    def _layers(
        self, layers: Layers, shaft: Shaft | None
    ) -> tuple[dict[str, Geometry], dict[str, tuple[Vec, ...]]]:
        ilm = _course(layers.x_px, layers.ilm_px, layers.ilm_seen, shaft)
        rpe = _course(layers.x_px, layers.rpe_px, layers.rpe_seen, shaft)
        found: dict[str, Geometry] = {}
        interpolated: dict[str, tuple[Vec, ...]] = {}
        for name, course in (("ilm", ilm), ("rpe", rpe)):
            if course is not None:
                found[name] = self._polyline(course.x_px, course.row_px)
                if ranges := self._unseen(course):
                    interpolated[name] = ranges
        if ilm is None:
            return found, interpolated
        found["retina_surface"] = found["ilm"]
        if rpe is not None:
            top = np.interp(rpe.x_px, ilm.x_px, ilm.row_px)
            for name, share in (
                ("subretinal_space", SUBRETINAL_SHARE),
                ("target_layer", self._registration.target_share),
            ):
                found[name] = self._polyline(rpe.x_px, top + share * (rpe.row_px - top))
        return found, interpolated

    def _polyline(self, x_px: Floats, row_px: Floats) -> Polyline:
        image = self._registration.image
        x_mm = (x_px - image.center_px[0]) * (-image.mm_per_px if image.mirrored else image.mm_per_px)
        y_mm = (image.center_px[1] - row_px) * self._axial_mm
        return Polyline(tuple(zip(x_mm.tolist(), y_mm.tolist(), strict=True)))

    def _unseen(self, course: _Course) -> tuple[Vec, ...]:
        """Return from where to where a surface was not seen itself, x in the eye frame [mm]."""
        edges = np.flatnonzero(np.diff(np.concatenate(([1], course.is_seen.astype(np.int8), [1]))))
        to_mm = self._registration.image.to_mm
        return tuple(
            (
                to_mm((float(course.x_px[max(start - 1, 0)]), 0.0))[0],
                to_mm((float(course.x_px[min(end, len(course.x_px) - 1)]), 0.0))[0],
            )
            for start, end in zip(edges[::2], edges[1::2], strict=True)
        )

    def _needle(self, shaft: Shaft) -> dict[str, Geometry]:
        to_mm = self._registration.image.to_mm
        tip = to_mm(shaft.tip_px)
        (x, y), (dx, dy) = shaft.tip_px, shaft.along_px
        way_px = min(y / dy, ((x - shaft.start_px[0]) / dx) if dx else math.inf)
        entry = to_mm((x - way_px * dx, y - way_px * dy))
        return {"needle_tip": Point(tip), "needle_line": Segment(entry, tip)}

    def _certainty(self, shaft: Shaft) -> Certainty:
        lateral_mm, axial_mm = self._registration.image.mm_per_px, self._axial_mm
        across_px, down_px = shaft.sd_px
        dx, dy = shaft.along_px
        right, down = dx * lateral_mm, dy * axial_mm
        turn = lateral_mm * axial_mm / (right * right + down * down)  # of the angle in mm, by that in px
        return Certainty(
            confidence=shaft.confidence,
            tip_sd_mm=math.hypot(across_px * lateral_mm, down_px * axial_mm),
            theta_sd_deg=turn * shaft.angle_sd_deg,
        )


def _course(x_px: Floats, row_px: Floats, seen: Mask, shaft: Shaft | None) -> _Course | None:
    """Return a surface from where it was first seen to where it was last seen, and on to below the tip."""
    columns = np.flatnonzero(seen)
    if not len(columns):
        return None
    first, last = int(columns[0]), int(columns[-1]) + 1
    x, is_seen = x_px[first:last], seen[first:last]
    course = _Course(x, np.interp(x, x[is_seen], row_px[first:last][is_seen]), is_seen)
    if shaft is None:
        return course
    tip_x = shaft.tip_px[0]
    if 0 < x[0] - tip_x + BESIDE_TIP_PX < FURTHEST_PX:
        return _joined(_end(x_px, row_px, seen, tip_x - BESIDE_TIP_PX), course)
    if 0 < tip_x + BESIDE_TIP_PX - x[-1] < FURTHEST_PX:
        return _joined(course, _end(x_px, row_px, seen, tip_x + BESIDE_TIP_PX))
    return course


def _end(x_px: Floats, row_px: Floats, seen: Mask, at_x_px: float) -> _Course:
    """Return one place of a surface beyond where it was seen."""
    row = row_at(x_px, row_px, seen, at_x_px)
    return _Course(np.array([at_x_px]), np.array([row]), np.array([False]))


def _joined(left: _Course, right: _Course) -> _Course:
    return _Course(*(np.concatenate(parts) for parts in zip(left, right, strict=True)))
