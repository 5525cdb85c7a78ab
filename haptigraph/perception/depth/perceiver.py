"""The shaft in space as an entity of the scene, besides what a perceiver finds in the image.

A straight shaft's inverse depth is linear along its image, and a stereo camera measures inverse depth with a
constant standard deviation: a line fit gives the depth of tip and trocar. The camera sees the surface of the
shaft; its width says how far behind the axis is.
"""

import math
from typing import NamedTuple

import numpy as np
from msgspec.structs import replace

from haptigraph.geometry import Point, Segment, Vec
from haptigraph.imaging import Floats, Mask
from haptigraph.messages import Capture, DepthImage, Observation
from haptigraph.perception.depth.line_fit import MIN_SAMPLES, Fit, robust_line
from haptigraph.perception.depth.sampling import BLOCK_PX, Blocks, sample
from haptigraph.perception.entities import NEEDLE_3D
from haptigraph.registration.camera import Registration
from haptigraph.registration.depth import DepthGeometry, DepthPlane
from haptigraph.stages import Perceiver

__all__ = ["DepthPerceiver"]

OUTSIDE_MM = 6.0  # outside the trocar, up to which the shaft is followed
HALF_WIDTH_MM = 0.6  # of the thickest shaft or cannula
WALL_MARGIN_MM = 0.3
SURFACE_SHARE, SURFACE_SD = math.pi / 4, 0.25  # of the radius, before the axis; a highlight is deeper
RADIUS_SD_MM = 0.06  # of a radius that was measured in the image: highlights and shade have edges, too
SIDES_SD_MM, TAPER_SD_MM = 0.07, 0.1  # of its differences: across the wall, and from there to the tip
RCM_SD_MM = 0.5  # of the shaft from the trocar's centre, across the section
RCM_SDS = 3.0
MAX_OUT_OF_PLANE_DEG = 75.0
MAX_SD_DEG = 1.0  # of a reported angle: 95 % are within 2 degrees
STEP = 1e-3  # share of a standard deviation, for derivatives


class _Strip(NamedTuple):
    """The line in the image as stored along which depth is sampled."""

    first_px: Vec
    """Outside the eye."""
    tip_px: Vec
    trocar_px: Vec

    @property
    def length_px(self) -> float:
        return math.dist(self.first_px, self.tip_px)

    @property
    def entry_px(self) -> float:
        """How far along it the trocar is."""
        along = np.subtract(self.tip_px, self.first_px) / self.length_px
        return float(along @ np.subtract(self.trocar_px, self.first_px))


class _InSpace(NamedTuple):
    """The shaft in space."""

    shaft: Segment
    tip_sd_mm: float
    """Standard deviation of the tip's z."""
    angle_sd_deg: float
    """Of its angle to the section."""


class DepthPerceiver:
    """Add the shaft in space to what a perceiver finds, where the depth image shows it.

    Nothing is added if too few depths are on a line, if its angle is too uncertain, or if it does not pass
    through the trocar: it is the background's then.

    Args:
        perceiver: Processes the image.
        registration: Of the images as stored.
        plane: Its section in depth.
        needle_mm: As in `PerceptionConfig`.
    """

    def __init__(
        self,
        perceiver: Perceiver,
        registration: Registration,
        plane: DepthPlane,
        needle_mm: tuple[float, float, float] | None = None,
    ) -> None:
        self._needle_mm = needle_mm
        self._perceiver, self._registration, self._plane = perceiver, registration, plane
        self._geometry = DepthGeometry(registration.image, plane)

    def __call__(self, capture: Capture) -> Observation:
        """Observe one image."""
        observation = self._perceiver(capture)
        line, depth = observation.found.get("needle_line"), capture.depth
        has_tip = isinstance(observation.found.get("needle_tip"), Point)
        if depth is None or not isinstance(line, Segment) or not has_tip or observation.certainty is None:
            return observation
        found = self._in_space(capture, depth, line, observation.certainty.tip_sd_mm or 0.0)
        if found is None:
            return observation
        shaft, tip_sd_mm, angle_sd_deg = found
        return replace(
            observation,
            found={**observation.found, NEEDLE_3D: shaft},
            sd_mm={**observation.sd_mm, NEEDLE_3D: tip_sd_mm},
            certainty=replace(observation.certainty, out_of_plane_sd_deg=angle_sd_deg),
        )

    def reset(self) -> None:
        """Forget earlier images."""
        self._perceiver.reset()

    def _in_space(
        self, capture: Capture, depth: DepthImage, line: Segment, tip_sd_mm: float
    ) -> _InSpace | None:
        """Return the shaft in space by all of it that is visible, or else by what is inside the eye.

        Args:
            capture: Has the image.
            depth: Of the image.
            line: The shaft in the image.
            tip_sd_mm: Standard deviation of its tip along it.
        """
        image = self._registration.checked(capture.image)
        to_px, mm_per_px = self._registration.image.to_px, self._registration.image.mm_per_px
        first_mm = self._first_mm(line)
        strip = _Strip(to_px(first_mm), to_px(line.end_mm), to_px(self._registration.trocar.at_mm))
        if strip.length_px < MIN_SAMPLES * BLOCK_PX:
            return None
        hidden = self._hidden(first_mm, line.end_mm, int(strip.length_px))
        stated_px = self._half_width_px(first_mm, line.end_mm, len(hidden))
        ends_px = strip.first_px, strip.tip_px
        blocks = sample(image, depth, ends_px, HALF_WIDTH_MM / mm_per_px, hidden, stated_px)
        inverse, systematic = self._of_axis(blocks, strip, is_stated=stated_px is not None)
        rounding_mm = depth.unit_mm / math.sqrt(12)
        sd = math.hypot(self._plane.camera.inverse_sd_per_mm, rounding_mm / self._plane.section_mm**2)
        for from_px in (-math.inf, strip.entry_px):
            part = blocks.along_px > from_px
            fit = robust_line(blocks.along_px[part], inverse[part], sd, systematic[:, part])
            found = fit and self._judged(fit, strip, tip_sd_mm)
            if found:
                return found
        return None

    def _of_axis(self, blocks: Blocks, strip: _Strip, *, is_stated: bool) -> tuple[Floats, Floats]:
        """Return one over the depth of the axis at each block, (n,), and its systematic errors, (k, n)."""
        tangent = blocks.half_px / self._plane.focal_px
        inverse = blocks.inverse_per_mm / (1 + SURFACE_SHARE * tangent)
        errors = [SURFACE_SD * tangent]
        if not is_stated:
            inside_px = max(strip.length_px - strip.entry_px, 1.0)
            inside = (blocks.along_px - strip.entry_px) / inside_px
            radius_mm = np.array(
                [
                    np.full(len(inside), RADIUS_SD_MM),
                    SIDES_SD_MM * np.where(inside > 0, 0.5, -0.5),
                    TAPER_SD_MM * np.maximum(inside, 0),
                ]
            )
            errors += [*SURFACE_SHARE * radius_mm / self._registration.image.mm_per_px / self._plane.focal_px]
        return inverse, np.array(errors) * inverse

    def _half_width_px(self, first_mm: Vec, tip_mm: Vec, count: int) -> Floats | None:
        """Return the half-width of the stated needle at each pixel of length, (count,); None: not stated."""
        if self._needle_mm is None:
            return None
        thin, thick, taper_mm = self._needle_mm
        behind_mm = math.dist(first_mm, tip_mm) * (1 - (np.arange(count) + 0.5) / count)
        share = np.minimum(behind_mm / max(taper_mm, 1e-9), 1.0)
        return np.asarray(
            (thin + (thick - thin) * share) / 2 / self._registration.image.mm_per_px, np.float64
        )

    def _first_mm(self, line: Segment) -> Vec:
        """Return the point of the section, outside the eye, from which the shaft is followed."""
        inwards = np.subtract(line.end_mm, line.start_mm) / math.dist(line.start_mm, line.end_mm)
        trocar = np.array(self._registration.trocar.at_mm)
        along_mm = float((trocar - np.array(line.start_mm)) @ inwards)
        x, y = np.array(line.start_mm) + (along_mm - OUTSIDE_MM) * inwards
        return float(x), float(y)

    def _hidden(self, first_mm: Vec, tip_mm: Vec, count: int) -> Mask:
        """Return where the wall hides the shaft, at each pixel of length, (count,)."""
        share = (np.arange(count)[:, None] + 0.5) / max(count, 1)
        at_mm = np.hypot(*(np.array(first_mm) * (1 - share) + np.array(tip_mm) * share).T)
        inner, middle = self._registration.globe.radius_mm, math.hypot(*self._registration.trocar.at_mm)
        outer = 2 * max(middle, inner) - inner
        return np.asarray((at_mm > inner - WALL_MARGIN_MM) & (at_mm < outer + WALL_MARGIN_MM), np.bool_)

    def _judged(self, fit: Fit, strip: _Strip, tip_sd_mm: float) -> _InSpace | None:
        """Return the shaft in space; None if it is too uncertain or does not pass through the trocar."""
        if min(fit(0.0), fit(strip.length_px)) <= 0:
            return None

        def numbers(answer: Floats) -> Floats:
            ends = self._ends_mm(replace(fit, answer=answer), strip)
            return np.array([ends[0, 2], ends[1, 2], _shaft(ends).out_of_plane_deg])

        ends, sds = self._ends_mm(fit, strip), np.sqrt(np.diag(fit.covariance))
        shaft = _shaft(ends)
        changes = np.column_stack([numbers(fit.answer + STEP * each) for each in np.diag(sds)])
        jacobian = (changes - numbers(fit.answer)[:, None]) / (STEP * sds)
        of_entry, of_tip, of_angle = np.sqrt(np.diag(jacobian @ fit.covariance @ jacobian.T)).tolist()
        entry_sd_mm = math.hypot(of_entry, self._plane_sd_mm(ends[0]), RCM_SD_MM)
        if abs(ends[0, 2]) > RCM_SDS * entry_sd_mm or abs(shaft.out_of_plane_deg) > MAX_OUT_OF_PLANE_DEG:
            return None
        along_sd_mm = tip_sd_mm * math.tan(math.radians(shaft.out_of_plane_deg))
        angle_sd_deg = math.hypot(of_angle, self._plane.tilt_sd_deg)
        if angle_sd_deg > MAX_SD_DEG:
            return None
        return _InSpace(shaft, math.hypot(of_tip, self._plane_sd_mm(ends[1]), along_sd_mm), angle_sd_deg)

    def _ends_mm(self, fit: Fit, strip: _Strip) -> Floats:
        """Return the shaft at the trocar and at the tip, (2, 3), eye frame."""
        along_px = np.array([strip.entry_px, strip.length_px])
        first, tip = np.array([strip.first_px, strip.tip_px])
        at_px = first + along_px[:, None] / strip.length_px * (tip - first)
        return self._geometry.to_eye_mm(at_px, 1 / np.array([fit(each) for each in along_px]))

    def _plane_sd_mm(self, at_mm: Floats) -> float:
        """Return the standard deviation of the section's z at a point."""
        plane = self._plane
        return math.hypot(plane.section_sd_mm, math.hypot(*at_mm[:2]) * math.radians(plane.tilt_sd_deg))


def _shaft(ends_mm: Floats) -> Segment:
    """Return the shaft between two points, (2, 3)."""
    (x0, y0, z0), (x1, y1, z1) = ends_mm.tolist()
    return Segment((x0, y0), (x1, y1), z0, z1)
