"""The shaft in space as an entity of the scene, besides what a perceiver finds in the image.

A straight shaft's inverse depth is linear along its image, and a stereo camera measures inverse depth with a
constant standard deviation: a line fit gives the depth of tip and trocar. The camera sees the shaft's surface;
its width in the image says how far behind the axis is.
"""

import math

import numpy as np
from msgspec.structs import replace

from haptigraph.geometry import Point, Segment, Vec
from haptigraph.imaging import Floats, Mask
from haptigraph.messages import Capture, DepthImage, Observation
from haptigraph.perception.depth.line_fit import MIN_SAMPLES, Fit, robust_line
from haptigraph.perception.depth.sampling import BLOCK_PX, sample
from haptigraph.perception.entities import NEEDLE_3D
from haptigraph.registration.camera import Registration
from haptigraph.registration.depth import DepthGeometry, DepthPlane
from haptigraph.stages import Perceiver

__all__ = ["DepthPerceiver"]

OUTSIDE_MM = 6.0  # outside the trocar, up to which the shaft is followed
HALF_WIDTH_MM = 0.6  # of the thickest shaft or cannula
WALL_MARGIN_MM = 0.3
SURFACE_SHARE, SURFACE_SD = math.pi / 4, 0.15  # of the radius: how far before the axis a shaft is, on average
WIDTH_SD_MM = 0.12  # of a radius that was measured in the image: highlights and shade have edges, too
RCM_SD_MM = 0.5  # of the shaft from the trocar's centre, across the section
RCM_SDS = 3.0
MAX_OUT_OF_PLANE_DEG = 75.0
STEP = 1e-3  # share of a standard deviation, for derivatives


class DepthPerceiver:
    """Add the shaft in space to what a perceiver finds, where the depth image shows it.

    Nothing is added if too few depths are on a line, or if that line does not pass through the trocar: it is
    the background's then.

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
        found = self._in_space(capture, depth, line)
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
        self, capture: Capture, depth: DepthImage, line: Segment
    ) -> tuple[Segment, float, float] | None:
        """Return the shaft, and the standard deviations of its tip's z [mm] and its angle [deg]."""
        image = self._registration.checked(capture.image)
        to_px, mm_per_px = self._registration.image.to_px, self._registration.image.mm_per_px
        inwards = np.subtract(line.end_mm, line.start_mm) / math.dist(line.start_mm, line.end_mm)
        first_mm = self._first_mm(line, inwards)
        first_px, tip_px = to_px(first_mm), to_px(line.end_mm)
        length_px = math.dist(first_px, tip_px)
        if length_px < MIN_SAMPLES * BLOCK_PX:
            return None
        hidden = self._hidden(first_mm, line.end_mm, int(length_px))
        stated_px = self._half_width_px(line, first_mm, len(hidden))
        blocks = sample(image, depth, (first_px, tip_px), HALF_WIDTH_MM / mm_per_px, hidden, stated_px)
        tangent = blocks.half_px / self._plane.focal_px
        inverse = blocks.inverse_per_mm / (1 + SURFACE_SHARE * tangent)
        systematic = [SURFACE_SD * tangent]
        if stated_px is None:
            constant = np.full(len(tangent), WIDTH_SD_MM / mm_per_px / self._plane.focal_px)
            systematic += [constant, constant * (blocks.along_px / length_px - 0.5)]
        fit = robust_line(blocks.along_px, inverse, self._inverse_sd(depth), np.array(systematic) * inverse)
        if fit is None or min(fit(0.0), fit(length_px)) <= 0:
            return None
        entry_px = to_px(self._registration.trocar.at_mm)
        at_px = (entry_px[0] - first_px[0]) * (tip_px[0] - first_px[0]) + (entry_px[1] - first_px[1]) * (
            tip_px[1] - first_px[1]
        )
        entry_share = at_px / length_px**2
        return self._judged(fit, (first_px, tip_px), length_px, entry_share)

    def _half_width_px(self, line: Segment, first_mm: Vec, count: int) -> Floats | None:
        """Return the half-width of the stated needle at each pixel of length, (count,); None if none is stated."""
        if self._needle_mm is None:
            return None
        thin, thick, taper_mm = self._needle_mm
        behind_mm = math.dist(first_mm, line.end_mm) * (1 - (np.arange(count) + 0.5) / count)
        share = np.minimum(behind_mm / max(taper_mm, 1e-9), 1.0)
        return np.asarray(
            (thin + (thick - thin) * share) / 2 / self._registration.image.mm_per_px, np.float64
        )

    def _first_mm(self, line: Segment, inwards: Floats) -> Vec:
        """Return the point of the section, outside the eye, from which the shaft is followed."""
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

    def _inverse_sd(self, depth: DepthImage) -> float:
        """Return the standard deviation of one over a depth [1/mm], with that of its rounding."""
        rounding_mm = depth.unit_mm / math.sqrt(12)
        return math.hypot(self._plane.camera.inverse_sd_per_mm, rounding_mm / self._plane.section_mm**2)

    def _judged(
        self, fit: Fit, ends_px: tuple[Vec, Vec], length_px: float, entry_share: float
    ) -> tuple[Segment, float, float] | None:
        """Return the shaft and its standard deviations; None if it does not pass through the trocar."""

        def numbers(answer: Floats) -> Floats:
            ends = self._ends_mm(replace(fit, answer=answer), ends_px, length_px, entry_share)
            return np.array([ends[0, 2], ends[1, 2], _angle_deg(ends)])

        sds = np.sqrt(np.diag(fit.covariance))
        changes = np.column_stack([numbers(fit.answer + STEP * each) for each in np.diag(sds)])
        jacobian = (changes - numbers(fit.answer)[:, None]) / (STEP * sds)
        entry_sd_mm, tip_sd_mm, angle_sd_deg = np.sqrt(np.diag(jacobian @ fit.covariance @ jacobian.T))
        ends = self._ends_mm(fit, ends_px, length_px, entry_share)
        tip_sd_mm, entry_sd_mm = (
            math.hypot(sd, self._plane_sd_mm(end))
            for sd, end in zip((tip_sd_mm, entry_sd_mm), ends[::-1], strict=True)
        )
        angle_sd_deg = math.hypot(angle_sd_deg, self._plane.tilt_sd_deg)
        if abs(ends[0, 2]) > RCM_SDS * math.hypot(entry_sd_mm, RCM_SD_MM):
            return None
        if abs(_angle_deg(ends)) > MAX_OUT_OF_PLANE_DEG:
            return None
        (x0, y0, z0), (x1, y1, z1) = ends.tolist()
        return Segment((x0, y0), (x1, y1), z0, z1), tip_sd_mm, angle_sd_deg

    def _ends_mm(self, fit: Fit, ends_px: tuple[Vec, Vec], length_px: float, entry_share: float) -> Floats:
        """Return the shaft at the trocar and at the tip, (2, 3), eye frame."""
        (first, tip), shares = np.array(ends_px), np.array([entry_share, 1.0])
        at_px = first + shares[:, None] * (tip - first)
        return self._geometry.to_eye_mm(at_px, 1 / np.array([fit(length_px * share) for share in shares]))

    def _plane_sd_mm(self, at_mm: Floats) -> float:
        """Return the standard deviation of the section's z at a point."""
        plane = self._plane
        return math.hypot(plane.section_sd_mm, math.hypot(*at_mm[:2]) * math.radians(plane.tilt_sd_deg))


def _angle_deg(ends_mm: Floats) -> float:
    """Return the angle of a shaft to the section, positive if it leads towards the camera."""
    right, up, towards = ends_mm[1] - ends_mm[0]
    return math.degrees(math.atan2(towards, math.hypot(right, up)))
