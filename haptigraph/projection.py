"""The mapping between the pixels of an image and the eye frame in millimetres."""

from __future__ import annotations

from functools import cached_property
from typing import TypeAlias

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from haptigraph.geometry import Vec
from haptigraph.lens import Lens

__all__ = [
    "DepthCamera",
    "DepthImage",
    "Homography",
    "ImageGeometry",
    "ImageMap",
    "LensMap",
    "Slices",
    "image_map",
]


class DepthImage(Struct, frozen=True, eq=False):
    """Depths along the camera's optical axis, pixel by pixel those of an image or of a part of it."""

    values: NDArray[np.uint16]
    """(h, w), in units; 0: not measured."""
    unit_mm: float
    left_px: int = 0
    top_px: int = 0


class Homography(Struct, frozen=True, dict=True):
    """A projective map between two images of a plane."""

    rows: tuple[tuple[float, float, float], ...]
    """The 3 x 3 matrix for homogeneous (x, y, 1)."""

    def __call__(self, at_px: Vec) -> Vec:
        """Return the position of a point in the other image."""
        x, y, scale = (row[0] * at_px[0] + row[1] * at_px[1] + row[2] for row in self.rows)
        return x / scale, y / scale

    def many(self, points_px: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the positions of points in the other image, (n, 2) each."""
        mapped = points_px @ self.matrix[:, :2].T + self.matrix[:, 2]
        return np.asarray(mapped[:, :2] / mapped[:, 2:])

    @cached_property
    def matrix(self) -> NDArray[np.float64]:
        """The rows, (3, 3)."""
        return np.array(self.rows, dtype=np.float64)

    @cached_property
    def inverse(self) -> Homography:
        """The inverse map.

        Raises:
            ValueError: If the matrix is singular.
        """
        try:
            back = np.linalg.inv(self.matrix)
        except np.linalg.LinAlgError:
            raise ValueError("a homography that maps a plane to a line has no inverse") from None
        return Homography(tuple(tuple(row) for row in (back / back[2, 2]).tolist()))


class LensMap(Struct, frozen=True):
    """From an image to one without distortion, and further by a homography, if there is one."""

    lens: Lens
    homography: Homography | None = None

    def __call__(self, at_px: Vec) -> Vec:
        """Return the position of a point in the corrected image."""
        ideal_px = self.lens.undistorted(at_px)
        return self.homography(ideal_px) if self.homography else ideal_px

    def inverse(self, corrected_px: Vec) -> Vec:
        """Return the position in the image of a point in the corrected one."""
        return self.lens.distorted(self.homography.inverse(corrected_px) if self.homography else corrected_px)


ImageMap: TypeAlias = Homography | LensMap
"""A map between two images, with its inverse."""


def image_map(lens: Lens | None, homography: Homography | None) -> ImageMap | None:
    """Return the map that corrects a lens, if given, and then applies a homography, if given."""
    return LensMap(lens, homography) if lens else homography


class Slices(Struct, frozen=True):
    """The B-scans of a volume, side by side in its image; the middle of all is the section z = 0."""

    count: int
    spacing_mm: float
    """From one B-scan to the next, along z."""
    columns: int
    """Of each B-scan."""

    def z_mm(self, number: int) -> float:
        """Return the position of a B-scan."""
        return (number - (self.count - 1) / 2) * self.spacing_mm

    def number(self, z_mm: float) -> int:
        """Return the number of the B-scan that is nearest to a position."""
        nearest = round(z_mm / self.spacing_mm + (self.count - 1) / 2)
        return min(max(nearest, 0), self.count - 1)


class ImageGeometry(Struct, frozen=True):
    """The map between the pixels of an image and the eye frame in millimetres.

    Pixels: the centre of the top-left pixel is (0, 0), x right, y down, in the image as stored. For a tilted
    camera and for a lens with distortion, centre and scale refer to the corrected image.
    """

    center_px: Vec
    """The globe's centre, the origin of the eye frame."""
    mm_per_px: float
    mirrored: bool
    """Whether the image as stored is left-right mirrored (seen through one mirror)."""
    frontal_from_image: ImageMap | None = None
    """From the image as stored to the view of a camera perpendicular to the section, without distortion."""
    axial_mm_per_px: float | None = None
    """Vertical scale where it differs from `mm_per_px`: the pixels of a B-scan are not square."""
    slices: Slices | None = None
    """Of a volume, whose first B-scan the other numbers describe."""

    def to_mm(self, at_px: Vec) -> Vec:
        """Convert a pixel position to the eye frame [mm]."""
        if self.frontal_from_image is not None:
            at_px = self.frontal_from_image(at_px)
        right = (at_px[0] - self.center_px[0]) * self.mm_per_px
        return -right if self.mirrored else right, (self.center_px[1] - at_px[1]) * self._down_mm_per_px

    def to_px(self, at_mm: Vec, z_mm: float = 0.0) -> Vec:
        """Convert an eye-frame position [mm] to pixels of the image as stored, in the nearest B-scan."""
        right = -at_mm[0] if self.mirrored else at_mm[0]
        left_px = self.slices.number(z_mm) * self.slices.columns if self.slices else 0
        at_px = (
            left_px + self.center_px[0] + right / self.mm_per_px,
            self.center_px[1] - at_mm[1] / self._down_mm_per_px,
        )
        return self.frontal_from_image.inverse(at_px) if self.frontal_from_image else at_px

    @property
    def _down_mm_per_px(self) -> float:
        return self.mm_per_px if self.axial_mm_per_px is None else self.axial_mm_per_px


class DepthCamera(Struct, frozen=True, forbid_unknown_fields=True):
    """A stereo depth camera, as a pinhole whose pixels are those of its images as stored."""

    focal_px: float
    principal_px: Vec
    """Where the optical axis meets the image."""
    disparity_px_mm: float
    """Disparity [px] times depth [mm]: the stereo pair's own focal length times its baseline."""
    subpixel_px: float = 0.08
    """Standard deviation of a disparity. Intel's "Tuning depth cameras for best performance" has
    sd_z = z^2 subpixel / (focal length * baseline), and 0.08 px as typical of the D400 series."""

    @property
    def inverse_sd_per_mm(self) -> float:
        """Standard deviation of one over a depth; the same at all depths."""
        return self.subpixel_px / self.disparity_px_mm
