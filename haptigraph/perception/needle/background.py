"""The background model: the eye without the needle, learned while the needle is elsewhere.

Turns images and where the needle was in them into the grey image behind it. Pixels that were never visible
without the needle are as in the registration's background image, or UNOBSERVED. Each image updates one band
of rows, which takes next to no time. Also chooses the grey, for an orange background may be as bright as
metal in the shade, but it is not as blue; and measures how much brighter the eye would be in good light.
"""

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from haptigraph.geometry import Vec, unit
from haptigraph.imaging import FloatImage, chroma_of, grey_of, grey_with_chroma
from haptigraph.messages import Image
from haptigraph.perception.native.pixels import LearnedBackground, PixelSample, Region
from haptigraph.perception.needle.rectify import (
    OUTSIDE_MM,
    UNOBSERVED,
    EyeGeometry,
    Line,
    RectifiedStrip,
    rectify,
)
from haptigraph.registration.background import BackgroundImage

__all__ = ["Background", "occluded_ends", "stripe"]

BANDS = 16
EVERY_PX = 8  # a pixel is sampled for the background's colour, and for the light
MIN_BLUE = 0.9  # of the background's brightness: with less, metal differs by its colour as well
CHROMA_RATE, MAX_CHROMA = 2.5, 0.4
BRIGHTEST = 99  # percentile of the globe and its wall that measures the light
ALIKE, MAX_CHANGE = (
    80,
    0.1,
)  # percent of an unchanged eye that differ by less than this share of its mean grey
LIT_GREY, DARK_GREY = 128, 32  # of that percentile: in good light; darker, nothing is visible


class Background:
    """A slowly adapting image of the eye without the needle.

    Args:
        eye: The eye's geometry.
        registered: The registration's background image, if any; newer images replace it.
        reach_px: How far from the globe's centre it is learned, in grey alone; if None, wherever a needle can
            be, with its colour.
    """

    def __init__(
        self, eye: EyeGeometry, registered: BackgroundImage | None = None, reach_px: float | None = None
    ) -> None:
        self._eye, self._registered = eye, registered
        self._is_inside = eye.is_inside()
        row, column = (EVERY_PX * part for part in self._is_inside[::EVERY_PX, ::EVERY_PX].nonzero())
        self._sampled = (row * eye.width_px + column).astype(np.int32)  # pixels for colour and light
        self._sample = PixelSample(self._is_inside.shape, self._sampled)
        self._bands, self._learns_chroma = eye.bands(BANDS), reach_px is None
        if reach_px is not None:
            self._bands = [_within(band, eye.center_px, reach_px) for band in self._bands]
        self.reset()

    def reset(self) -> None:
        """Forget everything."""
        planes = np.empty((2, self._eye.height_px, self._eye.width_px), np.float32)  # at once: in large pages
        planes[0], planes[1] = UNOBSERVED, 0
        self.grey: FloatImage = planes[0]
        self.chroma: FloatImage = planes[1]
        """How much bluer than red it is, where the grey is known, unless the grey alone is learned."""
        self.chroma_share = 0.0
        """How much of blue less red is added to the grey within the globe."""
        self.light = 1.0
        """How many times brighter the eye would be in good light; 1 in good light, or in the dark."""
        self._band = 0
        self.is_new = True
        self._to_restore, was_visible = self._registered, np.zeros(self.grey.shape, np.bool_)
        chroma = self.chroma if self._learns_chroma else None
        self._learned = LearnedBackground(self._is_inside, was_visible, self.grey, chroma)

    def measure_light(self, image: Image) -> None:
        """Measure the light and, until something is learned, choose the grey."""
        if not len(self._sampled):
            return
        rank = len(self._sampled) * BRIGHTEST // 100
        brightest = self._sample.ranked_grey(np.ascontiguousarray(image), rank)
        self.light = max(LIT_GREY / brightest, 1.0) if brightest >= DARK_GREY else 1.0
        if self.is_new:
            sample = image.reshape(-1, *image.shape[2:]).take(self._sampled, axis=0)  # faster than a mask
            self.chroma_share = _chroma_share(sample)
            self._restore(image)

    def _restore(self, image: Image) -> None:
        """Begin with the registered background image, if the eye still looks like it."""
        registered, self._to_restore = self._to_restore, None
        if registered is not None and (gain := _gain_since(registered, image)) is not None:
            grey = grey_with_chroma(registered.image, self.chroma_share, self._is_inside)
            np.copyto(self.grey, grey * np.float32(gain), where=registered.is_known)
            np.copyto(self.chroma, chroma_of(registered.image) * np.float32(gain), where=registered.is_known)

    def learn(self, image: Image, needle: tuple[Vec, Vec] | None, width_px: int) -> None:
        """Learn what is visible of the background.

        Args:
            image: The image.
            needle: The two ends of the region that the needle may occlude [px]; None if there is no needle.
            width_px: Width of that region.
        """
        if self.is_new:
            self.measure_light(image)
        bands = range(BANDS) if self.is_new else (self._band,)
        for band in bands:
            self._learn_band(image, band, needle, width_px)
        self._band = (self._band + 1) % BANDS
        self.is_new = False

    def rectify(self, image: Image, line: Line, *runs_px: FloatImage) -> list[RectifiedStrip] | None:
        """Rectify the image along one or more parts of a line, and subtract the background."""
        return rectify(
            self._eye,
            image,
            self.grey,
            line,
            *runs_px,
            chroma=self.chroma,
            chroma_share=self.chroma_share,
            light=self.light,
        )

    def _learn_band(self, image: Image, band: int, needle: tuple[Vec, Vec] | None, width_px: int) -> None:
        rows, columns = self._bands[band]
        if columns.start >= columns.stop:
            return
        is_free = None
        if needle is not None and _reaches(needle, width_px, rows):
            is_free = np.ones((rows.stop - rows.start, columns.stop - columns.start), np.bool_)
            corners = stripe(needle, width_px, (columns.start, rows.start))
            cv2.fillConvexPoly(is_free.view(np.uint8), corners, 0, shift=4)
        self._learned.learn(image, (rows, columns), self.chroma_share, is_free)


def _reaches(ends: tuple[Vec, Vec], width_px: int, rows: slice) -> bool:
    """Return whether a stripe may reach some rows."""
    (_, one), (_, other) = ends
    return bool(min(one, other) - width_px < rows.stop and max(one, other) + width_px > rows.start)


def _within(band: Region, center_px: Vec, radius_px: float) -> Region:
    """Return the part of a band that a circle reaches."""
    rows, columns = band
    x, y = center_px
    aside = max(rows.start - y, y - rows.stop, 0.0)
    half_px = math.sqrt(max(radius_px**2 - aside**2, 0.0))
    first, stop = max(columns.start, math.floor(x - half_px)), min(columns.stop, math.ceil(x + half_px) + 1)
    return rows, slice(first, stop if half_px else first)


def _chroma_share(sample: Image) -> float:
    """Return how much of blue less red to add: the more, the less blue the background is."""
    if sample.ndim == 1:
        return 0.0
    background = np.median(sample, axis=0).astype(np.uint8)
    lack = MIN_BLUE - float(background[0]) / max(float(grey_of(background[None, None])[0, 0]), 1.0)
    return min(max(CHROMA_RATE * lack, 0.0), MAX_CHROMA)


def _gain_since(registered: BackgroundImage, image: Image) -> float | None:
    """Return how many times brighter the eye is than in its background image.

    None if it looks different: it has moved, or is lit from elsewhere. A needle in the image occludes too
    little to count.
    """
    every = slice(EVERY_PX // 2, None, EVERY_PX)
    is_known = registered.is_known[every, every]
    if not is_known.any():
        return None
    now, before = (
        cv2.blur(grey_of(picture), (EVERY_PX, EVERY_PX))[every, every][is_known].astype(np.float32)
        for picture in (image, registered.image)
    )
    gain = float(now.sum()) / max(float(before.sum()), 1.0)
    change = float(np.percentile(np.abs(now - gain * before), ALIKE))
    return gain if change <= MAX_CHANGE * float(now.mean()) else None


def occluded_ends(eye: EyeGeometry, line: Line, until_px: float) -> tuple[Vec, Vec]:
    """Return the two ends of the region that a needle may occlude, up to a position along its line [px]."""
    from_px = -2 * OUTSIDE_MM * eye.px_per_mm
    return line.at_px(eye.trocar_px, from_px), line.at_px(eye.trocar_px, until_px)


def stripe(ends: tuple[Vec, Vec], width_px: int, corner_px: Vec) -> NDArray[np.int32]:
    """Return the corners of a stripe, for OpenCV to fill (shift=4), (4, 2) in 1/16 pixels.

    Args:
        ends: Of its middle line [px].
        width_px: Of the stripe.
        corner_px: First pixel of the image that it is filled in.
    """
    (x0, y0), (x1, y1) = ends
    across = unit((y0 - y1, x1 - x0))
    half_x, half_y = across[0] * width_px / 2, across[1] * width_px / 2
    corners = [(x0 - half_x, y0 - half_y), (x1 - half_x, y1 - half_y), (x1 + half_x, y1 + half_y)]
    corners.append((x0 + half_x, y0 + half_y))
    left, top = corner_px
    return np.array([(round((x - left) * 16), round((y - top) * 16)) for x, y in corners], np.int32)
