"""Surfaces and needle of a B-scan as an observation, for all OCT perceivers.

Turns surfaces and a shaft (px) into positions (eye frame, mm). A surface is reported from its first to its
last visible column, and extended below the tip, where the needle's own shadow hides it; `interpolated` lists
the parts that are not visible themselves. Between the surfaces are the target layer and the subretinal space.
"""

import math
from typing import NamedTuple

import numpy as np

from haptigraph.geometry import Geometry, Point, Polyline, Segment, Vec
from haptigraph.imaging import Floats, Mask
from haptigraph.messages import Certainty, Observation
from haptigraph.perception.oct.needle import SHADOW_MARGIN_PX, row_at
from haptigraph.registration.oct import ScanRegistration

__all__ = ["Layers", "ObservationBuilder", "Shaft", "casts_shadow"]

SUBRETINAL_SHARE = 0.9  # of the distance from ILM to RPE: end of the outer segments, where the space can open
BEYOND_TIP_PX = 8.0  # extension of a surface beyond the tip
MAX_EXTENSION_PX = 60.0  # of a surface beyond its visible part
MAX_TISSUE_SHARE = 0.08  # of all columns, with visible tissue in a shadow


class Layers(NamedTuple):
    """Both surfaces, by column; rows are undefined where a surface is not visible."""

    x_px: Floats
    """Positions of the columns, ascending, (n,)."""
    ilm_px: Floats
    ilm_visible: Mask
    rpe_px: Floats
    rpe_visible: Mask


class Shaft(NamedTuple):
    """A needle in the image."""

    tip_px: Vec
    start_px: Vec
    """Where its line enters the image, or is first visible."""
    along_px: Vec
    """Direction, length 1; it points down."""
    sd_px: Vec
    """Lateral and axial standard deviation of the tip."""
    angle_sd_deg: float
    """In the image, whose pixels are not square."""
    confidence: float


def casts_shadow(shaft: Shaft, layers: Layers) -> bool:
    """Return whether no tissue is visible where a needle would shadow it; a ghost casts no shadow."""
    (x, y), (dx, dy) = shaft.tip_px, shaft.along_px
    behind = math.copysign(1.0, dx) * (x - layers.x_px) > SHADOW_MARGIN_PX
    shaft_y = y + dy / dx * (layers.x_px - x) if dx else np.full_like(layers.x_px, -math.inf)
    visible = layers.ilm_visible & behind & (layers.ilm_px > shaft_y + SHADOW_MARGIN_PX)
    return float(visible.mean()) <= MAX_TISSUE_SHARE


class _SurfaceLine(NamedTuple):
    """One surface as it is reported."""

    x_px: Floats
    row_px: Floats
    is_visible: Mask


class ObservationBuilder:
    """Convert layers and shaft to an observation in millimetres.

    Args:
        registration: Size and scale of the B-scans, and the depth of the target.
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
        ilm = _surface_line(layers.x_px, layers.ilm_px, layers.ilm_visible, shaft)
        rpe = _surface_line(layers.x_px, layers.rpe_px, layers.rpe_visible, shaft)
        found: dict[str, Geometry] = {}
        interpolated: dict[str, tuple[Vec, ...]] = {}
        for name, line in (("ilm", ilm), ("rpe", rpe)):
            if line is not None:
                found[name] = self._polyline(line.x_px, line.row_px)
                if ranges := self._interpolated_ranges(line):
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

    def _interpolated_ranges(self, line: _SurfaceLine) -> tuple[Vec, ...]:
        """Return the ranges in which a surface is not visible itself, x in the eye frame [mm]."""
        edges = np.flatnonzero(np.diff(np.concatenate(([1], line.is_visible.astype(np.int8), [1]))))
        to_mm = self._registration.image.to_mm
        return tuple(
            (
                to_mm((float(line.x_px[max(start - 1, 0)]), 0.0))[0],
                to_mm((float(line.x_px[min(end, len(line.x_px) - 1)]), 0.0))[0],
            )
            for start, end in zip(edges[::2], edges[1::2], strict=True)
        )

    def _needle(self, shaft: Shaft) -> dict[str, Geometry]:
        to_mm = self._registration.image.to_mm
        tip = to_mm(shaft.tip_px)
        (x, y), (dx, dy) = shaft.tip_px, shaft.along_px
        distance_px = min(y / dy, ((x - shaft.start_px[0]) / dx) if dx else math.inf)
        entry = to_mm((x - distance_px * dx, y - distance_px * dy))
        return {"needle_tip": Point(tip), "needle_line": Segment(entry, tip)}

    def _certainty(self, shaft: Shaft) -> Certainty:
        lateral_mm, axial_mm = self._registration.image.mm_per_px, self._axial_mm
        across_px, down_px = shaft.sd_px
        dx, dy = shaft.along_px
        right, down = dx * lateral_mm, dy * axial_mm
        turn = lateral_mm * axial_mm / (right * right + down * down)  # d(angle in mm) / d(angle in px)
        return Certainty(
            confidence=shaft.confidence,
            tip_sd_mm=math.hypot(across_px * lateral_mm, down_px * axial_mm),
            theta_sd_deg=turn * shaft.angle_sd_deg,
        )


def _surface_line(x_px: Floats, row_px: Floats, visible: Mask, shaft: Shaft | None) -> _SurfaceLine | None:
    """Return a surface from its first to its last visible column, extended below the tip."""
    columns = np.flatnonzero(visible)
    if not len(columns):
        return None
    first, last = int(columns[0]), int(columns[-1]) + 1
    x, is_visible = x_px[first:last], visible[first:last]
    line = _SurfaceLine(x, np.interp(x, x[is_visible], row_px[first:last][is_visible]), is_visible)
    if shaft is None:
        return line
    tip_x = shaft.tip_px[0]
    if 0 < x[0] - tip_x + BEYOND_TIP_PX < MAX_EXTENSION_PX:
        return _joined(_extrapolated(x_px, row_px, visible, tip_x - BEYOND_TIP_PX), line)
    if 0 < tip_x + BEYOND_TIP_PX - x[-1] < MAX_EXTENSION_PX:
        return _joined(line, _extrapolated(x_px, row_px, visible, tip_x + BEYOND_TIP_PX))
    return line


def _extrapolated(x_px: Floats, row_px: Floats, visible: Mask, at_x_px: float) -> _SurfaceLine:
    """Return one point of a surface beyond its visible part."""
    row = row_at(x_px, row_px, visible, at_x_px)
    return _SurfaceLine(np.array([at_x_px]), np.array([row]), np.array([False]))


def _joined(left: _SurfaceLine, right: _SurfaceLine) -> _SurfaceLine:
    return _SurfaceLine(*(np.concatenate(parts) for parts in zip(left, right, strict=True)))
