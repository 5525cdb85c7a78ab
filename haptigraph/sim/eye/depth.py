"""The simulated depth camera: depths of eye and shaft with the noise of a stereo camera such as the D405.

A ray through each pixel meets the shaft, the cut wall, the bowl or what is behind; one over its depth gets
noise of constant standard deviation, as a disparity has. At the shaft's silhouette there are holes and depths
between shaft and background; a shaft too thin for the matching window has no others.
"""

import math
from statistics import NormalDist
from typing import Annotated

import cv2
import numpy as np
from msgspec import Meta, Struct

from haptigraph.geometry import Segment, Vec, subtract
from haptigraph.imaging import Floats, Mask
from haptigraph.messages import DepthImage
from haptigraph.projection import DepthCamera, ImageGeometry
from haptigraph.registration.depth import DepthGeometry, DepthPlane
from haptigraph.sim.eye.eye import Eye
from haptigraph.sim.eye.needle import NeedleShape
from haptigraph.sim.eye.optics import CameraSettings

__all__ = ["DepthRenderer", "DepthShape", "needle_in_space"]

Share = Annotated[float, Meta(ge=0, le=1)]

SEED = 7
BEYOND_MM = 8.0  # of the globe, which is rendered; the camera's depths end there
BEHIND_MM = 25.0  # from the section to what is behind the eye
STEP_PX = 1 / 32  # of disparities, as the D400 series computes them
FLYING_SHARE = 0.4  # of the pixels at the silhouette; the others are holes
HIGHLIGHT_PX = 5.0  # size of the holes that highlights leave on the shaft


class DepthShape(Struct, frozen=True, forbid_unknown_fields=True):
    """The [depth] table of a scenario; the defaults are a D405 at 848 x 480 px, 87 degrees wide."""

    disparity_px_mm: Annotated[float, Meta(gt=0, le=1e6)] = 8040.0
    """Focal length [px] times baseline [mm]: 447 px, 18 mm."""
    subpixel_px: Annotated[float, Meta(ge=0, le=2)] = 0.08
    """Standard deviation of a disparity."""
    window_px: Annotated[float, Meta(gt=0, le=20)] = 2.0
    """Standard deviation of the matching window, over which depths are averaged and their noise is alike."""
    edge_px: Annotated[float, Meta(ge=0, le=20)] = 1.5
    """How far to either side of the silhouette depths are wrong."""
    missing_share: Share = 0.05
    """Of the pixels without depth anywhere, and"""
    shaft_missing_share: Share = 0.3
    """on the shaft, where highlights have no texture."""
    scale_error: Annotated[float, Meta(ge=-0.1, le=0.1)] = 0.0
    """Share by which all depths are too large; 2 % at most, at 0.5 m, in the D405's data sheet."""
    unit_mm: Annotated[float, Meta(gt=0, le=1)] = 0.1
    outside: bool = True
    """Whether the shaft is visible outside the eye."""


def needle_in_space(tip_mm: Vec, eye: Eye, needle: NeedleShape, camera: CameraSettings) -> Segment:
    """Return the shaft from the trocar, which is in the section, to the tip, eye frame.

    Args:
        tip_mm: Where the tip appears in the section.
        eye: Has the trocar.
        needle: Has the angle out of the section.
        camera: Frontal; from its position the tip appears there.
    """
    foot_mm = _foot_mm(camera)
    rise, tip, z_mm = math.tan(math.radians(needle.tilt_deg)), tip_mm, 0.0
    out = subtract(tip_mm, eye.trocar_mm)
    side = -1.0 if out[0] * eye.trocar_mm[0] + out[1] * eye.trocar_mm[1] > 0 else 1.0  # outside the eye
    for _ in range(5):  # the nearer the tip, the smaller what appears so large
        z_mm = side * rise * math.dist(tip, eye.trocar_mm)
        share = 1 - z_mm / camera.distance_mm
        tip = (
            foot_mm[0] + (tip_mm[0] - foot_mm[0]) * share,
            foot_mm[1] + (tip_mm[1] - foot_mm[1]) * share,
        )
    return Segment(eye.trocar_mm, tip, 0.0, z_mm)


def _foot_mm(camera: CameraSettings) -> Vec:
    """Return the point of the section that a frontal camera is above."""
    middle_px = (camera.width_px - 1) / 2, (camera.height_px - 1) / 2
    return ImageGeometry(camera.center_px, 1 / camera.px_per_mm, camera.mirrored).to_mm(middle_px)


class DepthRenderer:
    """Render the depth images of one phantom.

    Args:
        eye: The eye.
        settings: The camera; its tilt is that of the section.
        needle: The instrument.
        shape: Noise.
        image: Between images and section.
        seed: Of the noise.
    """

    def __init__(
        self,
        eye: Eye,
        settings: CameraSettings,
        needle: NeedleShape,
        shape: DepthShape,
        image: ImageGeometry,
        seed: int,
    ) -> None:
        self._eye, self._needle, self._shape, self._seed = eye, needle, shape, seed
        focal_px = settings.distance_mm * settings.px_per_mm
        principal_px = (settings.width_px - 1) / 2, (settings.height_px - 1) / 2
        self.camera = DepthCamera(focal_px, principal_px, shape.disparity_px_mm, max(shape.subpixel_px, 1e-3))
        section_mm = settings.distance_mm, settings.distance_mm * (1 + shape.scale_error)
        true, self.plane = (
            DepthPlane(focal_px, principal_px, shape.disparity_px_mm, at_mm, settings.tilt_deg, 0.0, 0.0)
            for at_mm in section_mm
        )
        """The section as this camera measures it, without noise."""
        half_px = (eye.radius_mm + BEYOND_MM) * settings.px_per_mm
        x, y = image.to_px((0.0, 0.0))
        self._left, self._top = max(math.floor(x - half_px), 0), max(math.floor(y - half_px), 0)
        columns = np.arange(self._left, min(math.ceil(x + half_px), settings.width_px))
        rows = np.arange(self._top, min(math.ceil(y + half_px), settings.height_px))
        self._size = len(rows), len(columns)
        grid = np.stack(np.meshgrid(columns, rows), axis=-1).reshape(-1, 2).astype(np.float64)
        geometry = DepthGeometry(image, true)
        self._origin = geometry.to_eye_mm(grid[:1], np.zeros(1))[0]
        self._rays = geometry.to_eye_mm(grid, np.ones(len(grid))) - self._origin  # per mm of depth
        self._background = self._of_eye().reshape(self._size)

    def render(self, shaft: Segment | None, number: int) -> DepthImage:
        """Measure one depth image.

        Args:
            shaft: From the trocar to the tip, as `needle_in_space` returns it; None: out of view.
            number: Of the image; chooses the noise.
        """
        shape, rng = self._shape, np.random.default_rng((self._seed, SEED, number))
        inverse, is_shaft = 1 / self._background, np.zeros(self._size, np.bool_)
        if shaft is not None:
            depth_mm = self._of_shaft(shaft).reshape(self._size)
            is_shaft = depth_mm < self._background
            weight = np.asarray(cv2.GaussianBlur(is_shaft.astype(np.float64), (0, 0), shape.window_px))
            front = cv2.GaussianBlur(np.where(is_shaft, 1 / depth_mm, 0), (0, 0), shape.window_px)
            inverse = np.where(is_shaft, front / np.maximum(weight, 1e-9), inverse)
            inverse = self._with_edges(inverse, is_shaft, rng)
        disparity = inverse * shape.disparity_px_mm + shape.subpixel_px * self._alike(rng, shape.window_px)
        disparity = STEP_PX * np.rint(disparity / STEP_PX)
        is_measured = (inverse > 0) & (disparity > 0) & (rng.random(self._size) >= shape.missing_share)
        if share := shape.shaft_missing_share:
            is_measured &= ~is_shaft | (self._alike(rng, HIGHLIGHT_PX) < NormalDist().inv_cdf(1 - share))
        depth_mm = (1 + shape.scale_error) * shape.disparity_px_mm / np.where(is_measured, disparity, np.inf)
        values = np.rint(np.minimum(depth_mm / shape.unit_mm, 65535)).astype(np.uint16)
        return DepthImage(values, shape.unit_mm, self._left, self._top)

    def _of_eye(self) -> Floats:
        """Return the depth of the eye at each pixel: the cut wall, the bowl, or what is behind."""
        shape, radius_mm = self._eye.shape, self._eye.radius_mm
        rim_mm = (shape.rim_mm - self._origin[2]) / self._rays[:, 2]
        off_mm = np.linalg.norm(self._origin[:2] + rim_mm[:, None] * self._rays[:, :2], axis=1)
        squared = (self._rays**2).sum(axis=1)
        along = self._rays @ self._origin
        within = np.maximum(along**2 - squared * (self._origin @ self._origin - radius_mm**2), 0)
        bowl_mm = (-along + np.sqrt(within)) / squared
        behind_mm = (-BEHIND_MM - self._origin[2]) / self._rays[:, 2]
        around_mm = np.where(off_mm < radius_mm + shape.wall_mm, rim_mm, behind_mm)
        return np.asarray(np.where(off_mm < radius_mm, bowl_mm, around_mm), np.float64)

    def _of_shaft(self, shaft: Segment) -> Floats:
        """Return the depth of the shaft's visible surface at each pixel; infinite beside it."""
        needle, tip = self._needle, np.array([*shaft.end_mm, shaft.end_z_mm])
        back = -np.array(shaft.along_mm)
        if not back.any():
            return np.full(len(self._rays), np.inf)
        if tip @ tip > np.array(shaft.start_mm) @ np.array(shaft.start_mm):
            back = -back  # the tip is outside, behind it the shaft leads away from the eye
        back /= np.linalg.norm(back)
        from_tip = self._origin - tip
        squared = (self._rays**2).sum(axis=1)
        on_ray, on_axis, both = self._rays @ from_tip, back @ from_tip, self._rays @ back
        depth_mm = (both * on_axis - on_ray) / (squared - both**2)
        along_mm = on_axis + depth_mm * both
        gap_mm = np.linalg.norm(from_tip + depth_mm[:, None] * self._rays - along_mm[:, None] * back, axis=1)
        thin, thick = needle.tip_diameter_mm / 2, needle.diameter_mm / 2
        width_mm = thin + (thick - thin) * np.clip(along_mm / needle.taper_mm, 0, 1)
        is_hit = (gap_mm < width_mm) & (along_mm >= 0) & (along_mm <= needle.length_mm)
        at_mm = np.linalg.norm(tip + along_mm[:, None] * back, axis=1)
        wall_mm = self._eye.radius_mm + self._eye.shape.wall_mm
        is_hit &= (at_mm < self._eye.radius_mm) | (self._shape.outside & (at_mm > wall_mm))
        front = np.sqrt(np.maximum(width_mm**2 - gap_mm**2, 0)) / np.sqrt(squared - both**2)
        return np.where(is_hit, depth_mm - front, np.inf)

    def _with_edges(self, inverse: Floats, is_shaft: Mask, rng: np.random.Generator) -> Floats:
        """Replace depths at the shaft's silhouette by holes (0) and by depths in between."""
        inside, outside = (
            cv2.distanceTransform(mask.astype(np.uint8), cv2.DIST_L2, 3) for mask in (is_shaft, ~is_shaft)
        )
        is_edge = np.maximum(inside, outside) <= self._shape.edge_px
        share = rng.random(self._size)
        flying = share * inverse + (1 - share) / self._background
        return np.asarray(
            np.where(is_edge, np.where(rng.random(self._size) < FLYING_SHARE, flying, 0), inverse), np.float64
        )

    def _alike(self, rng: np.random.Generator, sd_px: float) -> Floats:
        """Return noise of standard deviation 1 that is alike within some pixels."""
        noise = cv2.GaussianBlur(rng.standard_normal(self._size), (0, 0), sd_px)
        return np.asarray(noise / noise.std(), np.float64)
