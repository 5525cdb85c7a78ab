"""The displayed view, "iOCT-fied" as in the paper (section II-B): the eye cropped, zoomed, grey, un-mirrored.

Of a volume, it shows three sections through the tip. For people only; perception does not use it.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping

import cv2
import numpy as np

from haptigraph.geometry import (
    Geometry,
    Point,
    Polyline,
    Segment,
    Surface,
    Vec,
    height_on_surface,
    section_of,
)
from haptigraph.imaging import FloatImage, grey_of, tilt_corrected
from haptigraph.messages import Image
from haptigraph.registration.camera import Registration
from haptigraph.registration.oct import ScanRegistration
from haptigraph.registration.registered import VIEW_MARGIN, BaseRegistration

__all__ = ["EyeView", "IoctView", "VolumeView", "view_of"]

GAP_MM = 0.1
"""Between the sections of a volume."""
GAP_GREY = 40


class EyeView(ABC):
    """A square picture of the eye, or of the sections of a volume.

    Args:
        size_px: Side of the picture.
        center_mm: Its middle, eye frame.
        half_mm: From its middle to its edge.
    """

    across_mm: float | None = None
    """Position along x at which the section across, of constant x, shows z = 0; None: of a volume only."""
    above_mm: float | None = None
    """Position along y at which the volume seen from above shows z = 0; z grows downwards there."""

    def __init__(self, size_px: int, center_mm: Vec, half_mm: float) -> None:
        self.size_px, self.center_mm, self.half_mm = size_px, center_mm, half_mm

    @abstractmethod
    def __call__(self, image: Image, found: Mapping[str, Geometry]) -> Image:
        """Return the picture, (size, size) grey.

        Args:
            image: As the source delivers it.
            found: What was found in it: sections go through the tip.
        """

    def drawn(self, found: Mapping[str, Geometry]) -> tuple[dict[str, Geometry], ...]:
        """Return what is to be drawn in each of its pictures, moved to its place; the main one is first."""
        return (dict(found),)

    def to_px(self, at_mm: Vec) -> Vec:
        """Turn an eye-frame position [mm] into pixels of the view."""
        scale = self.size_px / (2 * self.half_mm)
        return (
            (at_mm[0] - self.center_mm[0] + self.half_mm) * scale - 0.5,
            (self.half_mm - at_mm[1] + self.center_mm[1]) * scale - 0.5,
        )

    def to_mm(self, at_px: Vec) -> Vec:
        """Turn pixels of the view into an eye-frame position [mm]."""
        scale = 2 * self.half_mm / self.size_px
        return (
            (at_px[0] + 0.5) * scale - self.half_mm + self.center_mm[0],
            self.half_mm - (at_px[1] + 0.5) * scale + self.center_mm[1],
        )


def view_of(registration: BaseRegistration, size_px: int = 480) -> EyeView:
    """Return the view for the images of a registration."""
    if isinstance(registration, ScanRegistration) and registration.image.slices is not None:
        return VolumeView(registration, size_px)
    return IoctView(registration, size_px)


class IoctView(EyeView):
    """Crop the eye from images of one registration.

    Args:
        registration: The globe; of a B-scan, all is shown, in true proportions.
        size_px: Side of the square view.
    """

    def __init__(self, registration: BaseRegistration, size_px: int = 480) -> None:
        super().__init__(size_px, (0.0, 0.0), registration.view_half_mm)
        corners_mm = [self.to_mm(corner) for corner in ((0, 0), (size_px, 0), (0, size_px))]
        self._image_from_view = cv2.getAffineTransform(
            np.array(((0, 0), (size_px, 0), (0, size_px)), np.float32),
            np.array([registration.frontal.image.to_px(corner) for corner in corners_mm], np.float32),
        )
        self._tilt = registration.image.frontal_from_image
        y, x = np.ogrid[:size_px, :size_px]
        center = (size_px - 1) / 2
        radius = size_px / 2 / VIEW_MARGIN if isinstance(registration, Registration) else size_px
        self._outside = np.hypot(x - center, y - center) > radius

    def __call__(self, image: Image, found: Mapping[str, Geometry] | None = None) -> Image:
        """Return the view, (size, size) grey."""
        grey = grey_of(image)
        view = cv2.warpAffine(
            tilt_corrected(grey, self._tilt) if self._tilt else grey,
            self._image_from_view,
            (self.size_px, self.size_px),
            flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
        )
        view[self._outside] = 0
        return np.asarray(view, np.uint8)


class VolumeView(EyeView):
    """Show a volume in three pictures to one scale: the B-scan through the tip, another across, and above.

    Args:
        registration: Of volumes.
        size_px: Side of the square view.
    """

    across_mm: float
    above_mm: float

    def __init__(self, registration: ScanRegistration, size_px: int = 480) -> None:
        axial_mm, slice_mm, lateral_mm = registration.voxel_mm
        self._registration, slices = registration, registration.image.slices
        if slices is None:
            raise ValueError("expected the registration of volumes")
        width, height = slices.columns * lateral_mm, registration.height_px * axial_mm
        depth = slices.count * slice_mm
        self.across_mm = width / 2 + GAP_MM + depth / 2
        self.above_mm = -(height / 2 + GAP_MM + depth / 2)
        center_mm = (depth + GAP_MM) / 2, -(depth + GAP_MM) / 2
        super().__init__(size_px, center_mm, (max(width, height) + depth + 3 * GAP_MM) / 2)
        self._sizes_mm, self._slices = (width, height, depth), slices

    def __call__(self, image: Image, found: Mapping[str, Geometry]) -> Image:
        """Return the view, (size, size) grey; without a tip, its sections go through the middle."""
        volume, geometry = self._registration.checked_volume(grey_of(image)), self._registration.image
        at = _tip(found)
        number = self._slices.number(at.z_mm)
        column = round(geometry.to_px(at.at_mm, at.z_mm)[0]) - number * volume.shape[2]
        column = min(max(column, 0), volume.shape[2] - 1)
        picture = np.full((self.size_px, self.size_px), GAP_GREY, np.uint8)
        width, height, depth = self._sizes_mm
        flip = -1 if geometry.mirrored else 1
        self._put(picture, volume[:, number, ::flip], (0.0, 0.0), (width, height))
        self._put(picture, volume[:, :, column], (self.across_mm, 0.0), (depth, height))
        above = _stretched(volume.mean(axis=0, dtype=np.float32)[:, ::flip])
        self._put(picture, above, (0.0, self.above_mm), (width, depth))
        return picture

    def drawn(self, found: Mapping[str, Geometry]) -> tuple[dict[str, Geometry], ...]:
        """Return the shapes in the B-scan through the tip, in the section across, and from above."""
        at = _tip(found)
        pictures: tuple[dict[str, Geometry], ...] = {}, {}, {}
        for name, shape in found.items():
            main = section_of(shape, at.z_mm) if isinstance(shape, Surface) else shape
            above = _projected(shape, lambda at_mm, z_mm: (at_mm[0], self.above_mm - z_mm))
            shown = main, self._across(shape, at.at_mm[0]), above
            for picture, projected in zip(pictures, shown, strict=True):
                if projected is not None:
                    picture[name] = projected
        return pictures

    def _across(self, shape: Geometry, x_mm: float) -> Geometry | None:
        """Return a shape in the section of constant x, z to the right; None if it does not show."""
        to_mm = self.across_mm
        if isinstance(shape, Surface):
            heights = ((to_mm + z_mm, height_on_surface(x_mm, z_mm, shape)) for z_mm in shape.z_mm)
            return Polyline(tuple(heights))
        return _projected(shape, lambda at_mm, z_mm: (to_mm + z_mm, at_mm[1]))

    def _put(self, picture: Image, section: Image, middle_mm: Vec, size_mm: Vec) -> None:
        """Draw a section; its first row is at the top."""
        (left, top), (right, bottom) = (
            self.to_px((middle_mm[0] + side * size_mm[0] / 2, middle_mm[1] - side * size_mm[1] / 2))
            for side in (-1, 1)
        )
        place = slice(round(top + 0.5), round(bottom + 0.5)), slice(round(left + 0.5), round(right + 0.5))
        height, width = picture[place].shape
        shown = cv2.resize(np.ascontiguousarray(section), (width, height), interpolation=cv2.INTER_AREA)
        picture[place] = np.asarray(shown, np.uint8)


def _projected(shape: Geometry, project: Callable[[Vec, float], Vec]) -> Geometry | None:
    """Return a shape with its points projected; None if it does not show."""
    if isinstance(shape, Point):
        return Point(project(shape.at_mm, shape.z_mm))
    if isinstance(shape, Segment):
        return Segment(project(shape.start_mm, shape.start_z_mm), project(shape.end_mm, shape.end_z_mm))
    return None


def _tip(found: Mapping[str, Geometry]) -> Point:
    tip = found.get("needle_tip")
    return tip if isinstance(tip, Point) else Point((0.0, 0.0))


def _stretched(values: FloatImage) -> Image:
    """Return values as grey levels; the darkest and brightest percent are clipped."""
    low, high = np.percentile(values, (1, 99))
    return np.asarray(np.clip(255 * (values - low) / max(high - low, 1.0), 0, 255), np.uint8)
