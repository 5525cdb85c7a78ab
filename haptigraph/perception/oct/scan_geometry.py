"""Surfaces and needle of a B-scan as an observation, for all OCT perceivers.

Turns surfaces and a shaft (px) into positions (eye frame, mm). A surface is reported from its first to its
last visible column, and extended below the tip, where the needle's own shadow hides it; `interpolated` lists
the parts that are not visible themselves. Between the surfaces are the target layer and the subretinal space.
"""

import math
from typing import NamedTuple

import numpy as np

from haptigraph.geometry import Geometry, Point, Polyline, Segment, Vec, subtract
from haptigraph.imaging import Floats, Mask
from haptigraph.messages import Certainty, Observation
from haptigraph.perception.oct.needle import row_at
from haptigraph.registration.oct import ScanRegistration

__all__ = ["SUBRETINAL_SHARE", "Layers", "ObservationBuilder", "Shaft"]

SUBRETINAL_SHARE = 0.9
"""Of the distance from ILM to RPE: end of the outer segments, where the space can open."""
BEYOND_TIP_PX = 8.0  # extension of a surface beyond the tip
MAX_EXTENSION_PX = 60.0  # of a surface beyond its visible part
ON_LINE_MM = 1e-9  # nearer to a line, a point is on it
SLOPE_SD = 0.12  # standard deviation of the slope of what is not visible, mm per mm


class Layers(NamedTuple):
    """Both surfaces, by column; rows are undefined where a surface is not visible."""

    x_px: Floats
    """Positions of the columns, ascending, (n,)."""
    ilm_px: Floats
    ilm_visible: Mask
    rpe_px: Floats
    rpe_visible: Mask
    ilm_sd_px: Floats | None = None
    rpe_sd_px: Floats | None = None
    """Standard deviations of the rows; None where they are not estimated."""


class Shaft(NamedTuple):
    """A needle in the image."""

    tip_px: Vec
    start_px: Vec
    """Where its line enters the image, or is first visible."""
    along_px: Vec
    """Direction, length 1; it points down."""
    sd_px: Vec | None
    """Lateral and axial standard deviation of the tip; None if it may be elsewhere, and is not reported."""
    angle_sd_deg: float
    """In the image, whose pixels are not square."""
    confidence: float


class _SurfaceLine(NamedTuple):
    """One surface as it is reported."""

    x_px: Floats
    row_px: Floats
    is_visible: Mask
    sd_px: Floats
    """NaN where it is not estimated."""


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
        lines = {
            "ilm": self._line(layers.x_px, layers.ilm_px, layers.ilm_visible, layers.ilm_sd_px, shaft),
            "rpe": self._line(layers.x_px, layers.rpe_px, layers.rpe_visible, layers.rpe_sd_px, shaft),
        }
        visible = {name: line for name, line in lines.items() if line is not None}
        visible |= self._layers_between(visible)
        found: dict[str, Geometry] = {name: self._polyline(line) for name, line in visible.items()}
        sds: dict[str, float | tuple[float, ...]] = {
            name: self._sds(line) for name, line in visible.items() if not np.isnan(line.sd_px[0])
        }
        if "ilm" in found:
            found["retina_surface"] = found["ilm"]
        if "ilm" in sds:
            sds["retina_surface"] = sds["ilm"]
        if shaft is not None:
            found |= self._needle(shaft)
        return Observation(
            stamp_ns,
            found,
            certainty=None if shaft is None else self._certainty(shaft),
            interpolated={
                name: ranges
                for name in ("ilm", "rpe")
                if name in visible and (ranges := self._interpolated_ranges(visible[name]))
            },
            sd_mm=sds,
        )

    def _line(
        self, x_px: Floats, row_px: Floats, visible: Mask, sd_px: Floats | None, shaft: Shaft | None
    ) -> _SurfaceLine | None:
        sd_px = np.full(len(x_px), math.nan) if sd_px is None else sd_px
        columns = _SurfaceLine(x_px, row_px, visible, sd_px)
        return _reported(columns, shaft, self._registration.image.mm_per_px / self._axial_mm)

    def _layers_between(self, lines: dict[str, _SurfaceLine]) -> dict[str, _SurfaceLine]:
        """Return the layers between ILM and RPE."""
        if not {"ilm", "rpe"} <= lines.keys():
            return {}
        ilm, rpe = lines["ilm"], lines["rpe"]
        top, top_sd = (np.interp(rpe.x_px, ilm.x_px, part) for part in (ilm.row_px, ilm.sd_px))
        shares = {"subretinal_space": SUBRETINAL_SHARE, "target_layer": self._registration.target_share}
        return {
            name: rpe._replace(
                row_px=top + share * (rpe.row_px - top),
                sd_px=np.hypot((1 - share) * top_sd, share * rpe.sd_px),
            )
            for name, share in shares.items()
        }

    def _polyline(self, line: _SurfaceLine) -> Polyline:
        image = self._registration.image
        x_mm = (line.x_px - image.center_px[0]) * (-image.mm_per_px if image.mirrored else image.mm_per_px)
        y_mm = (image.center_px[1] - line.row_px) * self._axial_mm
        return Polyline(tuple(zip(x_mm.tolist(), y_mm.tolist(), strict=True)))

    def _sds(self, line: _SurfaceLine) -> tuple[float, ...]:
        return tuple((self._axial_mm * line.sd_px).round(5).tolist())

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
        tip, start = to_mm(shaft.tip_px), to_mm(shaft.start_px)
        ahead = to_mm((shaft.start_px[0] + shaft.along_px[0], shaft.start_px[1] + shaft.along_px[1]))
        line = Segment(start, _nearest_on_line(tip, start, ahead))
        return (
            {"needle_line": line} if shaft.sd_px is None else {"needle_tip": Point(tip), "needle_line": line}
        )

    def _certainty(self, shaft: Shaft) -> Certainty:
        lateral_mm, axial_mm = self._registration.image.mm_per_px, self._axial_mm
        across_px, down_px = shaft.sd_px or (0.0, 0.0)
        dx, dy = shaft.along_px
        right, down = dx * lateral_mm, dy * axial_mm
        turn = lateral_mm * axial_mm / (right * right + down * down)  # d(angle in mm) / d(angle in px)
        return Certainty(
            confidence=shaft.confidence,
            tip_sd_mm=math.hypot(across_px * lateral_mm, down_px * axial_mm) if shaft.sd_px else None,
            theta_sd_deg=turn * shaft.angle_sd_deg,
        )


def _nearest_on_line(point: Vec, start: Vec, ahead: Vec) -> Vec:
    """Return the point nearest to a point on the line through two others."""
    (dx, dy), (x, y) = subtract(ahead, start), subtract(point, start)
    along = (x * dx + y * dy) / (dx * dx + dy * dy)
    nearest = start[0] + along * dx, start[1] + along * dy
    return point if math.dist(point, nearest) < ON_LINE_MM else nearest


def _reported(columns: _SurfaceLine, shaft: Shaft | None, aspect: float) -> _SurfaceLine | None:
    """Return a surface from its first to its last visible column, extended below the tip.

    Args:
        columns: The surface in all columns.
        shaft: The needle, if there is one.
        aspect: Width of a pixel over its height.
    """
    at = np.flatnonzero(columns.is_visible)
    if not len(at):
        return None
    first, last = int(at[0]), int(at[-1]) + 1
    x, is_visible = columns.x_px[first:last], columns.is_visible[first:last]
    row, sd = (np.interp(x, x[is_visible], part[at]) for part in (columns.row_px, columns.sd_px))
    if not is_visible.all():
        gap_px = np.abs(x[~is_visible, None] - x[is_visible]).min(axis=1)
        sd[~is_visible] = np.hypot(sd[~is_visible], SLOPE_SD * aspect * gap_px)
    line = _SurfaceLine(x, row, is_visible, sd)
    if shaft is None:
        return line
    tip_x = shaft.tip_px[0]
    if 0 < x[0] - tip_x + BEYOND_TIP_PX < MAX_EXTENSION_PX:
        return _joined(_extrapolated(columns, x[0], tip_x - BEYOND_TIP_PX, aspect), line)
    if 0 < tip_x + BEYOND_TIP_PX - x[-1] < MAX_EXTENSION_PX:
        return _joined(line, _extrapolated(columns, x[-1], tip_x + BEYOND_TIP_PX, aspect))
    return line


def _extrapolated(columns: _SurfaceLine, from_x_px: float, at_x_px: float, aspect: float) -> _SurfaceLine:
    """Return one point of a surface beyond its visible part."""
    x, row, is_visible, sd = columns
    sd_px = math.hypot(float(np.interp(from_x_px, x, sd)), SLOPE_SD * aspect * abs(at_x_px - from_x_px))
    row_px = row_at(x, row, is_visible, at_x_px)
    return _SurfaceLine(np.array([at_x_px]), np.array([row_px]), np.array([False]), np.array([sd_px]))


def _joined(left: _SurfaceLine, right: _SurfaceLine) -> _SurfaceLine:
    return _SurfaceLine(*(np.concatenate(parts) for parts in zip(left, right, strict=True)))
