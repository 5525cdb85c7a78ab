"""The simulated camera's settings, and the geometry of its images."""

import math

from msgspec import Struct

from haptigraph.geometry import Vec
from haptigraph.projection import ImageGeometry
from haptigraph.registration.tilt import CameraTilt

__all__ = ["CameraSettings", "image_geometry", "slant_of"]


class CameraSettings(Struct, frozen=True, forbid_unknown_fields=True):
    """The [camera] table of a scenario."""

    width_px: int = 1280
    height_px: int = 720
    center_px: Vec = (640.0, 402.0)
    """Position of the globe's centre in the image."""
    px_per_mm: float = 20.0
    mirrored: bool = True
    tilt_deg: Vec = (0.0, 0.0)
    """Tilt of the section against the image plane, (right, down): the side that is farther away."""
    distance_mm: float = 250.0
    """From the camera to the section; matters only with a tilt or with a wall in front of the section."""
    blur_px: float = 0.8
    """Standard deviation of the lens blur."""
    shutter_s: float = 0.0
    """Exposure time, in which the needle moves; the ground truth is that of its middle. 0: a flash."""
    shake_px: float = 0.0
    """Length of the camera's own motion during the exposure, the same in every image."""
    shake_deg: float = 0.0
    """Its direction in the image, from x towards y."""
    exposure: float = 1.0
    """Brightness of the whole scene; from about 1.3 on, white surfaces saturate."""
    vignetting: float = 0.25
    """Loss of light in the corners."""
    read_noise_grey: float = 1.0
    shot_noise_grey: float = 2.5
    """Standard deviation at full white; proportional to the square root of the light."""
    shadow: float = 0.15
    """Share of light that the needle blocks from the bowl behind it; 0: none."""
    shadow_shift: Vec = (0.25, 0.3)
    """Displacement of the shadow, (right, down), per depth of the bowl."""


def image_geometry(settings: CameraSettings) -> ImageGeometry:
    """Return the mapping between a camera's images and the eye frame."""
    frontal_from_image = slant_of(settings).frontal_from_image if settings.tilt_deg != (0.0, 0.0) else None
    center_px, mm_per_px = settings.center_px, 1 / settings.px_per_mm
    return ImageGeometry(center_px, mm_per_px, settings.mirrored, frontal_from_image)


def slant_of(settings: CameraSettings) -> CameraTilt:
    """Return the tilt of the section as seen by a camera."""
    right, down = (math.radians(angle) for angle in settings.tilt_deg)
    focal_px = settings.distance_mm * settings.px_per_mm
    middle_px = (settings.width_px - 1) / 2, (settings.height_px - 1) / 2
    return CameraTilt(settings.center_px, (right, down), focal_px, middle_px)
