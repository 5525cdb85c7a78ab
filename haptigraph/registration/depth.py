"""The plane of the section as a depth camera measures it, and from pixels with a depth to the eye frame."""

import math
from typing import Annotated

import numpy as np
from msgspec import Meta, Struct
from numpy.typing import NDArray

from haptigraph.geometry import Vec
from haptigraph.projection import DepthCamera, ImageGeometry
from haptigraph.toml_document import Document

__all__ = ["DepthGeometry", "DepthPlane", "check_depth", "depth_table"]

Positive = Annotated[float, Meta(gt=0, le=1e6)]
Tilt = Annotated[float, Meta(ge=-45, le=45)]
MAX_SCALE = 1.2
"""Between the depths' scale and that of the globe, either way; what is beyond belongs to another set-up."""


class DepthPlane(Struct, frozen=True, forbid_unknown_fields=True):
    """The [depth] table of a registration."""

    focal_px: Positive
    principal_px: Vec
    disparity_px_mm: Positive
    section_mm: Positive
    """Depth of the section at the globe's centre, along the folded path."""
    tilt_deg: tuple[Tilt, Tilt]
    """Of the section against the sensor, (right, down): the side that is farther away."""
    section_sd_mm: Annotated[float, Meta(ge=0, le=10)]
    tilt_sd_deg: Annotated[float, Meta(ge=0, le=45)]
    """Per axis."""
    subpixel_px: Annotated[float, Meta(gt=0, le=2)] = 0.08

    @property
    def camera(self) -> DepthCamera:
        """The camera that measured it."""
        return DepthCamera(self.focal_px, self.principal_px, self.disparity_px_mm, self.subpixel_px)


def check_depth(document: Document, depth: DepthPlane | None, image: ImageGeometry) -> DepthPlane | None:
    """Return a file's [depth] table if it fits the globe's scale; None if there is none.

    Raises:
        BadInput: If it does not fit.
    """
    if depth is None:
        return None
    scale = depth.focal_px * image.mm_per_px / depth.section_mm
    if not 1 / MAX_SCALE <= scale <= MAX_SCALE:
        raise document.error(
            f"at {depth.section_mm:g} mm a globe of the registered size would be {1 / scale:.2f} times as "
            f"large as registered; {1 / MAX_SCALE:.2f} to {MAX_SCALE:g} is plausible",
            "depth.section_mm",
        )
    return depth


def depth_table(depth: DepthPlane | None) -> str:
    """Return the [depth] table as TOML; empty without one."""
    if depth is None:
        return ""
    (x, y), (right, down) = depth.principal_px, depth.tilt_deg
    return f"""
[depth]  # the section, as the depth camera measures it; optional
focal_px = {depth.focal_px:.3f}
principal_px = [{x:.3f}, {y:.3f}]
disparity_px_mm = {depth.disparity_px_mm:.3f}
subpixel_px = {depth.subpixel_px:g}
section_mm = {depth.section_mm:.4f}
section_sd_mm = {depth.section_sd_mm:.4f}
tilt_deg = [{right:.4f}, {down:.4f}]
tilt_sd_deg = {depth.tilt_sd_deg:.4f}
"""


class DepthGeometry:
    """The map from pixels with a depth to the eye frame.

    Depths are scaled so that the globe has its registered size: the calibration of a stereo camera errs by
    the same share everywhere.

    Args:
        image: Between the images and the section.
        plane: The section in depth.
    """

    def __init__(self, image: ImageGeometry, plane: DepthPlane) -> None:
        self.plane = plane
        self.scale = plane.focal_px * image.mm_per_px / plane.section_mm
        """Of true depths over measured ones."""
        slopes = [math.tan(math.radians(angle)) for angle in plane.tilt_deg]
        normal = np.array([*slopes, -1.0]) / math.hypot(*slopes, 1.0)  # towards the camera
        self._axes = np.array([_turned((1.0, 0.0), normal), _turned((0.0, -1.0), normal), normal])
        if image.mirrored:
            self._axes[0] *= -1
        center_px = np.array([image.to_px((0.0, 0.0))])
        self._center_mm = self._in_camera(center_px, np.array([self.scale * plane.section_mm]))[0]

    def to_eye_mm(self, at_px: NDArray[np.float64], depth_mm: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return where pixels of the image as stored are, (n, 3), eye frame.

        Args:
            at_px: (n, 2).
            depth_mm: As measured, along the optical axis, (n,).
        """
        positions = self._in_camera(at_px, self.scale * depth_mm)
        return np.asarray((positions - self._center_mm) @ self._axes.T, np.float64)

    def _in_camera(self, at_px: NDArray[np.float64], depth_mm: NDArray[np.float64]) -> NDArray[np.float64]:
        rays = (at_px - np.array(self.plane.principal_px)) / self.plane.focal_px
        return np.column_stack([rays * depth_mm[:, None], depth_mm])


def _turned(across: Vec, normal: NDArray[np.float64]) -> NDArray[np.float64]:
    """Turn an axis of the image by the smallest rotation that takes the optical axis to a plane's normal."""
    axis, towards = np.array([*across, 0.0]), np.array([0.0, 0.0, -1.0])
    turned = axis - (normal @ axis) / (1 + towards @ normal) * (towards + normal)
    return np.asarray(turned, np.float64)
