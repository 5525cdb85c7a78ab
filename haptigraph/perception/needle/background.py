"""The empty eye as the camera sees it, learned while the needle is elsewhere.

Turns images and where the needle was in them into the grey picture behind the needle. Pixels that were never
seen without the needle are as they were when the eye was registered, or UNOBSERVED. Learns a band of rows per
image, so that it costs next to nothing.
Tells in which grey to look: orange ground may be as bright as metal in the shade, but it is not as blue; and
how much brighter all would be in good light.
"""

from itertools import pairwise

import cv2
import numpy as np
from numpy.typing import NDArray

from haptigraph.geometry import Vec, unit
from haptigraph.imaging import FloatImage, grey_of, grey_with_chroma
from haptigraph.messages import Image
from haptigraph.perception.needle.rectify import OUTSIDE_MM, UNOBSERVED, Line, RectifiedStrip, Site, rectify
from haptigraph.registration.background import BackgroundImage

__all__ = ["Background", "occluded_ends", "stripe"]

BANDS = 16
RATE = 0.25
EVERY_PX = 8  # a pixel tells the ground's colour, and the light
LEAST_BLUE = 0.9  # of the ground's brightness: with less, metal is told by its colour as well
CHROMA_RATE, MOST_CHROMA = 2.5, 0.4
BRIGHTEST = 99  # percent of the globe and its wall are no brighter than what tells the light
ALIKE, CHANGED_SHARE = 80, 0.1  # percent of an eye that differ by less of its mean grey: it is still the same
LIT_GREY, DARK_GREY = 128, 32  # of that: so bright in good light; darker, there is nothing to see


class Background:
    """A slowly adapting picture of the empty eye.

    Args:
        site: Where the globe is, and which part of the image is worth knowing.
        empty: What was seen of the empty eye before, if anything; what is seen now counts for more.
    """

    def __init__(self, site: Site, empty: BackgroundImage | None = None) -> None:
        self._site, self._empty = site, empty
        self._is_inside = site.is_inside()
        row, column = (EVERY_PX * part for part in self._is_inside[::EVERY_PX, ::EVERY_PX].nonzero())
        self._told = row * site.width_px + column  # numbers of the pixels that tell ground and light
        rows, self._columns = site.box
        edges = [rows.start + band * (rows.stop - rows.start) // BANDS for band in range(BANDS + 1)]
        self._bands = [slice(*ends) for ends in pairwise(edges)]
        self.reset()

    def reset(self) -> None:
        """Forget everything."""
        self.grey: FloatImage = np.full((self._site.height_px, self._site.width_px), UNOBSERVED, np.float32)
        self.chroma_share = 0.0
        """How much of blue less red the grey within the globe has in it."""
        self.light = 1.0
        """How many times brighter the eye would be in good light; 1 where it is bright enough."""
        self._band = 0
        self.is_new = True
        self._is_seen, self._to_remember = np.zeros(self.grey.shape, np.bool_), self._empty
        self._is_whole = [False] * BANDS

    def look(self, image: Image) -> None:
        """Tell how bright the light is, and until something was learned, in which grey to look."""
        if not len(self._told):
            return
        seen = image.reshape(-1, *image.shape[2:]).take(self._told, axis=0)  # an eighth of the time of a mask
        self.light = _light(seen)
        if self.is_new:
            self.chroma_share = _chroma_share(seen)
            self._remember(image)

    def _remember(self, image: Image) -> None:
        """Begin with the eye as it was when it was registered, if it still looks like that."""
        empty, self._to_remember = self._to_remember, None
        if empty is not None and (gain := _gain_since(empty, image)) is not None:
            grey = grey_with_chroma(empty.image, self.chroma_share, self._is_inside)
            np.copyto(self.grey, grey * np.float32(gain), where=empty.is_known)

    def learn(self, image: Image, needle: tuple[Vec, Vec] | None, width_px: int) -> None:
        """Take in what is visible of the empty eye.

        Args:
            image: The image.
            needle: The two ends of what the needle may cover [px]; None if there is no needle.
            width_px: How wide a stripe about it to leave out.
        """
        if self.is_new:
            self.look(image)
        bands = range(BANDS) if self.is_new else (self._band,)
        for band in bands:
            self._learn_band(image, band, needle, width_px)
        self._band = (self._band + 1) % BANDS
        self.is_new = False

    def strips(self, image: Image, line: Line, *runs_px: FloatImage) -> list[RectifiedStrip] | None:
        """Lay one or more parts of a line straight, with the empty eye taken away (`rectify`)."""
        return rectify(
            self._site, image, self.grey, line, *runs_px, chroma_share=self.chroma_share, light=self.light
        )

    def _learn_band(self, image: Image, band: int, needle: tuple[Vec, Vec] | None, width_px: int) -> None:
        rows, columns = self._bands[band], self._columns
        grey = grey_with_chroma(image[rows, columns], self.chroma_share, self._is_inside[rows, columns])
        kept = self.grey[rows, columns]
        free = np.full(grey.shape, 255, np.uint8)
        if needle is not None:
            cv2.fillConvexPoly(free, stripe(needle, width_px, (columns.start, rows.start)), 0, shift=4)
        if not self._is_whole[band]:
            is_seen = self._is_seen[rows, columns]
            fresh = ~is_seen & (free > 0)
            kept[fresh] = grey[fresh]
            free[~is_seen] = 0
            is_seen |= fresh
            self._is_whole[band] = bool(is_seen.all())
        cv2.accumulateWeighted(grey, kept, RATE, free)


def _chroma_share(seen: Image) -> float:
    """Return how much of blue less red tells metal from the ground: the more, the less blue the ground is."""
    if seen.ndim == 1:
        return 0.0
    ground = np.median(seen, axis=0).astype(np.uint8)
    lack = LEAST_BLUE - float(ground[0]) / max(float(grey_of(ground[None, None])[0, 0]), 1.0)
    return min(max(CHROMA_RATE * lack, 0.0), MOST_CHROMA)


def _gain_since(empty: BackgroundImage, image: Image) -> float | None:
    """Return how many times brighter an eye is than when it was registered.

    None if it looks different: it has moved, or is lit from elsewhere. A needle that came hides too little to
    count.
    """
    every = slice(EVERY_PX // 2, None, EVERY_PX)
    is_known = empty.is_known[every, every]
    if not is_known.any():
        return None
    now, before = (
        cv2.blur(grey_of(picture), (EVERY_PX, EVERY_PX))[every, every][is_known].astype(np.float32)
        for picture in (image, empty.image)
    )
    gain = float(now.sum()) / max(float(before.sum()), 1.0)
    off = float(np.percentile(np.abs(now - gain * before), ALIKE))
    return gain if off <= CHANGED_SHARE * float(now.mean()) else None


def _light(seen: Image) -> float:
    """Return how many times brighter it would be in good light; 1 where it is lit well, or all is dark."""
    grey, rank = seen if seen.ndim == 1 else grey_of(seen[None])[0], len(seen) * BRIGHTEST // 100
    brightest = float(np.partition(grey, rank)[rank])
    return max(LIT_GREY / brightest, 1.0) if brightest >= DARK_GREY else 1.0


def occluded_ends(site: Site, line: Line, until_px: float) -> tuple[Vec, Vec]:
    """Return the two ends of what a needle may cover that ends so far along a line [px]."""
    from_px = -2 * OUTSIDE_MM * site.px_per_mm
    return line.at_px(site.trocar_px, from_px), line.at_px(site.trocar_px, until_px)


def stripe(ends: tuple[Vec, Vec], width_px: int, corner_px: Vec) -> NDArray[np.int32]:
    """Return the corners of a stripe, for OpenCV to fill (shift=4), (4, 2) in 1/16 pixels.

    Args:
        ends: Of its middle line [px].
        width_px: Of the stripe.
        corner_px: Where the image begins that it is filled in.
    """
    (x0, y0), (x1, y1) = ends
    across = unit((y0 - y1, x1 - x0))
    half_x, half_y = across[0] * width_px / 2, across[1] * width_px / 2
    corners = [(x0 - half_x, y0 - half_y), (x1 - half_x, y1 - half_y), (x1 + half_x, y1 + half_y)]
    corners.append((x0 + half_x, y0 + half_y))
    return np.rint((np.array(corners) - corner_px) * 16).astype(np.int32)
