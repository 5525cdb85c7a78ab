"""Surfaces and needle of a B-scan as an observation, for all OCT perceivers.

Turns surfaces and a shaft (px) into positions (eye frame, mm). A surface is reported from its first to its
last visible column, and extended below the tip, where the needle's own shadow hides it; `interpolated` lists
the parts that are not visible themselves. Between the surfaces are the target layer and the subretinal space.
"""

import math
from typing import NamedTuple

from haptigraph.geometry import Geometry, Point, Polyline, Segment, Vec, subtract
from haptigraph.imaging import Floats, Mask
from haptigraph.messages import Certainty, Observation
from haptigraph.perception.native.surface_lines import LineLimits, SurfaceColumns, surface_lines
from haptigraph.perception.oct.surfaces import SLOPE_COLUMNS
from haptigraph.registration.oct import ScanRegistration

__all__ = ["SUBRETINAL_SHARE", "Layers", "ObservationBuilder", "Shaft"]

LINES = ("ilm", "rpe", "subretinal_space", "target_layer")
SUBRETINAL_SHARE = 0.9
"""Of the distance from ILM to RPE: end of the outer segments, where the space can open."""
BEYOND_TIP_MM = 0.06  # lateral extension of a surface beyond the tip
ALONE_MM, PARALLEL_MM = 0.14, 0.47  # further from what is visible, the ILM is not known; the RPE below it
ON_LINE_MM = 1e-9  # nearer to a line, a point is on it
SLOPE_SD = 0.07  # standard deviation of the slope of what is not visible, mm per mm


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


class ObservationBuilder:
    """Convert layers and shaft to an observation in millimetres.

    Args:
        registration: Size and scale of the B-scans, and the depth of the target.
    """

    def __init__(self, registration: ScanRegistration) -> None:
        self._registration = registration
        image = registration.image
        self._axial_mm = image.axial_mm_per_px or image.mm_per_px
        self._limits = LineLimits(
            tip_px=math.nan,
            beyond_px=BEYOND_TIP_MM / image.mm_per_px,
            alone_px=ALONE_MM / image.mm_per_px,
            parallel_px=PARALLEL_MM / image.mm_per_px,
            slope_sd=SLOPE_SD * image.mm_per_px / self._axial_mm,
            center_px=image.center_px,
            right_mm=-image.mm_per_px if image.mirrored else image.mm_per_px,
            down_mm=self._axial_mm,
            shares=(SUBRETINAL_SHARE, registration.target_share),
            slope_columns=SLOPE_COLUMNS,
        )

    def __call__(self, stamp_ns: int, layers: Layers, shaft: Shaft | None) -> Observation:
        """Return the observation of one B-scan."""
        limits = self._limits if shaft is None else self._limits._replace(tip_px=shaft.tip_px[0])
        lines = surface_lines(
            SurfaceColumns(layers.x_px, layers.ilm_px, layers.ilm_sd_px, layers.ilm_visible),
            SurfaceColumns(layers.x_px, layers.rpe_px, layers.rpe_sd_px, layers.rpe_visible),
            limits,
        )
        ilm, rpe = lines.counts[:2]
        between = rpe if ilm else 0
        found: dict[str, Geometry] = {}
        sds: dict[str, float | tuple[float, ...]] = {}
        for number, (name, count) in enumerate(zip(LINES, (ilm, rpe, between, between), strict=True)):
            if count:
                found[name] = Polyline(tuple(zip(*lines.points_mm[number, :, :count].tolist(), strict=True)))
                if not math.isnan(lines.sds_mm[number, 0]):
                    sds[name] = tuple(lines.sds_mm[number, :count].tolist())
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
                name: tuple(map(tuple, ranges_mm[:count].tolist()))
                for name, ranges_mm, count in zip(LINES[:2], lines.ranges_mm, lines.counts[2:], strict=True)
                if count
            },
            sd_mm=sds,
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
