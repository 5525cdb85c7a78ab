"""Names for arrays of pixels, and conversions of images. Shared by all of perception."""

from functools import lru_cache
from typing import Any, Literal, TypeAlias

import cv2
import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from haptigraph.messages import Image
from haptigraph.projection import Homography, ImageMap, LensMap

__all__ = [
    "UPRIGHT",
    "FloatImage",
    "Floats",
    "Mask",
    "Rotation",
    "Turn",
    "chroma_of",
    "colored",
    "grey_of",
    "grey_with_chroma",
    "peak_offset",
    "tilt_corrected",
    "tilt_restored",
]

FloatImage: TypeAlias = NDArray[np.float32]
Floats: TypeAlias = NDArray[np.float64]
Mask: TypeAlias = NDArray[np.bool_]
Rotation: TypeAlias = Literal[0, 90, 180, 270]

ROTATIONS = {90: cv2.ROTATE_90_CLOCKWISE, 180: cv2.ROTATE_180, 270: cv2.ROTATE_90_COUNTERCLOCKWISE}
UNDISTORTING_STEPS, UNDISTORTING_PRECISION = 60, 1e-3  # iterations at most, and px
GREY = 0.114, 0.587, 0.299  # shares of blue, green and red (ITU-R BT.601), as OpenCV has them


class Turn(Struct, frozen=True):
    """How the images of a source are turned before anything else sees them."""

    rotate_deg: Rotation = 0
    """Clockwise."""
    mirror: bool = False
    """Whether left and right are exchanged, after the rotation."""

    def __call__(self, image: Image) -> Image:
        """Return an image turned."""
        if self.rotate_deg:
            image = np.asarray(cv2.rotate(image, ROTATIONS[self.rotate_deg]), np.uint8)
        return np.ascontiguousarray(image[:, ::-1]) if self.mirror else image

    def size_before_px(self, size_px: tuple[int, int]) -> tuple[int, int]:
        """Return the (width, height) that an image must have before, to have one afterwards."""
        return (size_px[1], size_px[0]) if self.rotate_deg in (90, 270) else size_px

    def __str__(self) -> str:
        return f"source.rotate_deg={self.rotate_deg} and source.mirror={str(self.mirror).lower()}"


UPRIGHT = Turn()
"""Images as they come."""


def grey_of(image: Image) -> Image:
    """Return an image in grey."""
    return image if image.ndim == 2 else np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), np.uint8)


def colored(image: Image) -> Image:
    """Return an image in colour, (h, w, 3) BGR."""
    return image if image.ndim == 3 else np.asarray(cv2.cvtColor(image, cv2.COLOR_GRAY2BGR), np.uint8)


def grey_with_chroma(image: Image, chroma_share: float, where: Mask | np.bool_) -> Image:
    """Return an image in grey, with bluer pixels brighter in some places.

    White and grey keep their brightness.

    Args:
        image: (h, w, 3) BGR or (h, w) grey, which is returned.
        chroma_share: How much of blue less red is added.
        where: The pixels to which it is added; broadcast to the image.
    """
    grey = grey_of(image)
    if image.ndim == 2 or not chroma_share:
        return grey
    weights = np.array([GREY]) + chroma_share * np.array([[1.0, 0.0, -1.0]])
    bluer = np.asarray(cv2.transform(image, weights), np.uint8).reshape(grey.shape)
    return np.where(where, bluer, grey)


def chroma_of(image: Image) -> FloatImage:
    """Return how much bluer than red each pixel is, (h, w) grey levels; 0 in an image without colour."""
    if image.ndim == 2:
        return np.zeros(image.shape, np.float32)
    return np.subtract(image[..., 0], image[..., 2], dtype=np.float32)


def tilt_corrected(image: Image, frontal_from_image: ImageMap) -> Image:
    """Return an image of the same size without tilt and distortion, (h, w, 3) or (h, w)."""
    height, width = image.shape[:2]
    if isinstance(frontal_from_image, Homography):
        return _warped(image, frontal_from_image.inverse)
    return _remapped(image, _image_from_frontal(frontal_from_image, width, height))


def tilt_restored(frontal: Image, frontal_from_image: ImageMap) -> Image:
    """Return an image as the camera takes it from one that was corrected, (h, w, 3) or (h, w)."""
    height, width = frontal.shape[:2]
    if isinstance(frontal_from_image, Homography):
        return _warped(frontal, frontal_from_image)
    return _remapped(frontal, _frontal_from_image(frontal_from_image, width, height))


def _warped(image: Image, from_result: Homography) -> Image:
    height, width = image.shape[:2]
    flags, matrix = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP, from_result.matrix
    return np.asarray(
        cv2.warpPerspective(image, matrix, (width, height), flags=flags, borderMode=cv2.BORDER_REPLICATE),
        np.uint8,
    )


def _remapped(image: Image, from_result: tuple[Any, Any]) -> Image:
    return np.asarray(
        cv2.remap(image, *from_result, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE), np.uint8
    )


@lru_cache(4)
def _image_from_frontal(frontal_from_image: LensMap, width: int, height: int) -> tuple[Any, Any]:
    """Return where each pixel of the corrected image is in the camera's, as OpenCV remaps fastest."""
    camera, distortion, corrected = _matrices(frontal_from_image)
    size = width, height
    return cv2.initUndistortRectifyMap(camera, distortion, np.eye(3), corrected, size, cv2.CV_16SC2)


@lru_cache(4)
def _frontal_from_image(frontal_from_image: LensMap, width: int, height: int) -> tuple[Any, Any]:
    """Return where each pixel of the camera's image is in the corrected one."""
    camera, distortion, corrected = _matrices(frontal_from_image)
    grid = np.stack(np.meshgrid(np.arange(width), np.arange(height)), axis=-1).reshape(-1, 1, 2)
    stop = cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, UNDISTORTING_STEPS, UNDISTORTING_PRECISION
    points = cv2.undistortPointsIter(
        grid.astype(np.float64), camera, distortion, np.eye(3), corrected, criteria=stop
    )
    x, y = np.moveaxis(points.reshape(height, width, 2).astype(np.float32), -1, 0)
    return cv2.convertMaps(x, y, cv2.CV_16SC2)


def _matrices(frontal_from_image: LensMap) -> tuple[Floats, Floats, Floats]:
    """Return the camera matrix, the distortion, and the camera matrix of the corrected image."""
    lens, homography = frontal_from_image.lens, frontal_from_image.homography
    (right, down), focal = lens.principal_px, lens.ideal_focal_px
    camera = np.array([[lens.focal_px[0], 0, right], [0, lens.focal_px[1], down], [0, 0, 1]])
    ideal = np.array([[focal, 0, right], [0, focal, down], [0, 0, 1]])
    return camera, np.array(lens.distortion), homography.matrix @ ideal if homography else ideal


def peak_offset(before: Floats, at: Floats, after: Floats) -> Floats:
    """Return the offset of the peak of the parabola through three samples from the middle one, (n,).

    In samples, -0.5 to 0.5; 0 where there is no peak.
    """
    curvature = before - 2 * at + after
    offset = 0.5 * (before - after) / np.where(curvature < 0, curvature, 1)
    return np.clip(np.where(curvature < 0, offset, 0), -0.5, 0.5)
