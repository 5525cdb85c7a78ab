"""Whether a rig's optics work: distances, field of view, scale, sharpness and the mirror's size, as designed.

The sharpness is that of a thin lens: the disc of defocus [px] is aperture * focal_px * |1/d - 1/focus| for a
point at distance d, and Airy's disc has the diameter 2.44 * wavelength * f-number (E. Hecht, Optics, 5th ed.,
2017, sections 5.2 and 10.2).
"""

import math

import numpy as np
from msgspec import Struct

from haptigraph.imaging import Floats
from haptigraph.registration.camera import MIN_RADIUS_PX
from haptigraph.rig.description import Rig
from haptigraph.rig.prediction import Prediction
from haptigraph.rig.view import View, as_designed

__all__ = ["OpticalCheck", "Optics", "optical_checks", "optics_of"]

SD_KEPT = 3.0  # tolerances are kept to this many standard deviations
NEAR_SECTION_MM = 1.5  # what moves there must be sharp
MAX_BLUR_PX = 2.0  # the colour filter of a sensor resolves no less
WAVELENGTH_UM = 0.55
TOUCHING_MM, ALIGNED_DEG = 0.7, 1.7
SHAFT_MM = 10.0
RIM_STEPS = 360


class OpticalCheck(Struct, frozen=True):
    """One property of the optics and its limit."""

    name: str
    value: float
    unit: str
    limit: float
    is_at_least: bool
    """Whether the limit is the least allowed value; else the largest."""
    advice: str
    """What to change if it is not met."""

    @property
    def is_met(self) -> bool:
        """Whether the value is within the limit."""
        return self.value >= self.limit if self.is_at_least else self.value <= self.limit


class Optics(Struct, frozen=True):
    """Figures of a rig's optics."""

    px_per_mm: float
    """Of the section."""
    touching_px: float
    """The distance of touching, 0.7 mm."""
    aligned_px: float
    """What the limit of alignment, 1.7 degrees, moves the end of 10 mm of shaft."""
    sharp_from_mm: float
    """Where the sharp range begins, in front of the section (negative: behind it); blur of at most 1 px."""
    sharp_to_mm: float
    """Where it ends, behind the section; infinite if it does not."""
    blur_px: float
    """Diameter of the blur at the worst point within 1.5 mm of the section."""
    airy_px: float
    """Diameter of Airy's disc."""


def optics_of(rig: Rig) -> Optics:
    """Return the figures of a rig's optics."""
    px_per_mm = rig.px_per_mm
    near, far = _sharp_mm(rig, 1.0)
    return Optics(
        px_per_mm=px_per_mm,
        touching_px=TOUCHING_MM * px_per_mm,
        aligned_px=SHAFT_MM * math.tan(math.radians(ALIGNED_DEG)) * px_per_mm,
        sharp_from_mm=rig.path_mm - near,
        sharp_to_mm=far - rig.path_mm,
        blur_px=max(_blur_px(rig, rig.path_mm + off) for off in (-NEAR_SECTION_MM, NEAR_SECTION_MM)),
        airy_px=_airy_px(rig),
    )


def optical_checks(prediction: Prediction) -> tuple[OpticalCheck, ...]:
    """Return the properties that a rig's optics must have, with what they are."""
    rig, optics = prediction.rig, optics_of(prediction.rig)
    front_mm = rig.path_mm - rig.camera.pupil_mm
    checks = [
        OpticalCheck(
            "distance of the camera's front from the section",
            front_mm,
            "mm",
            rig.camera.nearest_mm,
            is_at_least=True,
            advice="the camera works only from there on: move it away (to_camera_mm)",
        ),
        OpticalCheck(
            "margin of the image around the eye",
            _image_margin_px(prediction),
            "px",
            0.0,
            is_at_least=True,
            advice="tolerances may cut the eye off: move the camera away or tighten them",
        ),
        OpticalCheck(
            "radius of the globe in the image",
            float(prediction.expected.radius_px[0]),
            "px",
            MIN_RADIUS_PX,
            is_at_least=True,
            advice="move the camera nearer, or use one with more pixels or a longer lens",
        ),
        OpticalCheck(
            f"blur within {NEAR_SECTION_MM} mm of the section",
            optics.blur_px,
            "px",
            MAX_BLUR_PX,
            is_at_least=False,
            advice="focus the lens on the section, or close its aperture",
        ),
    ]
    if rig.mirrors:
        checks.append(
            OpticalCheck(
                "margin of the mirror around the rays from the eye",
                _mirror_margin_mm(rig),
                "mm",
                SD_KEPT * rig.tolerances.position_mm,
                is_at_least=True,
                advice="take a larger mirror (size_mm), or move it nearer to the camera",
            )
        )
    return tuple(checks)


def _aperture_mm(rig: Rig) -> float:
    camera = rig.camera
    return camera.focal_px * camera.pixel_um / 1000 / camera.f_number


def _airy_px(rig: Rig) -> float:
    return 2.44 * WAVELENGTH_UM * rig.camera.f_number / rig.camera.pixel_um


def _blur_px(rig: Rig, distance_mm: float) -> float:
    """Return the diameter of the blur at a distance from the pupil, by defocus and diffraction."""
    defocus_px = _aperture_mm(rig) * rig.camera.focal_px * abs(1 / distance_mm - 1 / rig.camera.focus_mm)
    return math.hypot(defocus_px, _airy_px(rig))


def _sharp_mm(rig: Rig, defocus_px: float) -> tuple[float, float]:
    """Return the distances from the pupil between which the disc of defocus stays within a size."""
    off, focus = defocus_px / (_aperture_mm(rig) * rig.camera.focal_px), 1 / rig.camera.focus_mm
    return 1 / (focus + off), 1 / (focus - off) if focus > off else math.inf


def _image_margin_px(prediction: Prediction) -> float:
    """Return how far the wall's outer edge stays inside the image, less what tolerances may move it."""
    rig, expected, sd = prediction.rig, prediction.expected, prediction.sd
    outer_px = float(expected.radius_px[0] * expected.rim_ratio[0] * expected.wall_ratio[0])
    growth = SD_KEPT * float(sd.radius_px[0] / expected.radius_px[0])
    half_px = np.array([rig.camera.width_px, rig.camera.height_px]) / 2
    margins_px = half_px - outer_px * (1 + growth) - SD_KEPT * sd.center_px[0]
    return float(margins_px.min())


def _mirror_margin_mm(rig: Rig) -> float:
    """Return how far the mirror extends beyond every ray from the opened eye to the pupil."""
    (mirror,), view = rig.mirrors, View(rig, as_designed())
    angles = np.linspace(0, 2 * math.pi, RIM_STEPS, endpoint=False)
    heights_mm = 0.0, rig.eye.cut_mm
    eye_mm = np.concatenate([view.on_globe(angles, rig.eye.wall_mm, height)[0] for height in heights_mm])
    pupil_mm = view.seen_mm[0] + _aperture_mm(rig) / 2 * np.column_stack(
        [np.cos(angles), np.sin(angles), np.zeros_like(angles)]
    )
    starts, ends = np.repeat(eye_mm, 4, axis=0), np.tile(pupil_mm[:: RIM_STEPS // 4], (len(eye_mm), 1))
    across_mm, along_mm = _on_mirror(view, starts, ends)
    width_mm, length_mm = mirror.size_mm
    return min(width_mm / 2 - float(np.abs(across_mm).max()), length_mm / 2 - float(np.abs(along_mm).max()))


def _on_mirror(view: View, starts: Floats, ends: Floats) -> tuple[Floats, Floats]:
    """Return where rays meet the mirror, from its centre: across it, and along its slope [mm]."""
    normal, center = view.mirror_normal[0], view.mirror_mm[0]
    rays = ends - starts
    share = ((center - starts) @ normal) / (rays @ normal)
    hits = starts + share[:, None] * rays - center
    slope = np.array([0.0, 0.0, 1.0]) - normal[2] * normal  # steepest way towards the camera
    slope /= np.linalg.norm(slope)
    return hits @ np.cross(slope, normal), hits @ slope
