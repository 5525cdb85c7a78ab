"""The upper edge of a bright band, in the grey of an image near the border that a network found.

The outer retina has several bright bands, some 40 µm apart. A network may follow the wrong one with
confidence, over half an image; then an edge from dark to bright is visible above its border. And the image
locates such an edge more precisely than the classes do. In atrophy, where the RPE is missing, the choroid
below is bright. The profile of grey across a border is what a second network judges it by.
"""

import cv2
import numpy as np

from haptigraph.geometry import Vec
from haptigraph.imaging import FloatImage, Floats, Mask, grey_of
from haptigraph.messages import Image

__all__ = ["PROFILE_VALUES", "averaged", "profiles", "strip", "transmits_light", "upper_edge"]

STEP_MM = 0.003  # between samples down a column; the next three are counts of samples
AVERAGED = 4  # on either side of an edge
NEAR = 5  # an edge at most so far below a border is its own; so near above it, none is counted
SEARCHED = 17  # above a border, for other edges
ALONG_MM, MIN_ALONG_COLUMNS = 0.2, 2  # averaged along a border, on either side
MAX_SHARE = 0.3  # contrast of other edges, relative to a border's own
RETINA, CHOROID = (-33, -7), (20, 50)  # 20 to 100 µm above a border; 60 to 150 µm below it
MAX_TRANSMITTED = 2.0  # brightness of the choroid over the dark, relative to that of the retina
DARK_PERCENT, BRIGHT_PERCENT = 5, 98  # of an image is as dark as without backscatter; all but 2 % is darker
PROFILE_STEP_MM, PROFILE = 0.006, (-45, 25)  # samples of a profile, 270 µm above to 150 µm below a border
PROFILE_WIDTHS_MM = (0.1, 0.2, 0.6)  # averaged along a border, on either side
PROFILE_VALUES = len(PROFILE_WIDTHS_MM) * (PROFILE[1] - PROFILE[0])
"""Number of values of a profile."""


def upper_edge(image: Image, row_px: Floats, mm_per_px: Vec) -> tuple[Floats, Mask]:
    """Move a border down to the strongest edge from dark to bright within 15 µm.

    The border is expected to be rather too high than too deep. Grey is averaged along it; it may be curved.

    Args:
        image: The image, (h, w) or (h, w, 3).
        row_px: Row of the border in columns of equal width, which together make up the image, (n,).
        mm_per_px: Lateral and axial scale of the image.

    Returns:
        The rows of the edge, (n,), and the columns without another edge 15 to 50 µm above the border.
    """
    rise = _rise(image, row_px, mm_per_px)
    above, own = rise[: SEARCHED - NEAR], rise[SEARCHED:]
    is_first = above.max(axis=0) < MAX_SHARE * own.max(axis=0)
    return np.asarray(row_px + own.argmax(axis=0) * (STEP_MM / mm_per_px[1])), np.asarray(is_first)


def transmits_light(image: Image, row_px: Floats, mm_per_px: Vec) -> Mask:
    """Return the columns, (n,), in which tissue below the RPE is bright: in atrophy, where there is none.

    There the choroid shines, and its edge may be mistaken for that of the RPE. Arguments as of `upper_edge`.
    """
    narrow, half = _narrow(image, len(row_px)), _half_columns(image, row_px, mm_per_px)
    above, below = (_mean_along(narrow, row_px, mm_per_px[1], half, span) for span in (RETINA, CHOROID))
    dark_grey = float(np.percentile(narrow, DARK_PERCENT))
    return np.asarray(below - dark_grey > MAX_TRANSMITTED * np.maximum(above - dark_grey, 1.0))


def profiles(image: Image, row_px: Floats, is_likely: Mask, mm_per_px: Vec) -> FloatImage:
    """Return the profile of grey across a border in each column, (n, values).

    0 is as dark as the image without backscatter, 1 is bright; all values are 0 where there is no border.

    Args:
        image: The image, (h, w) or (h, w, 3).
        row_px: Row of the border in columns of equal width, which together make up the image, (n,).
        is_likely: The columns in which there is one, (n,).
        mm_per_px: Lateral and axial scale of the image.
    """
    grey, levels = strip(image, row_px, mm_per_px)
    return averaged(grey, levels, image.shape[1] * mm_per_px[0] / len(row_px), is_likely)


def strip(image: Image, row_px: Floats, mm_per_px: Vec) -> tuple[FloatImage, tuple[float, float]]:
    """Return the grey near a border, (samples, n), and what is dark and what is bright in the image."""
    narrow = _narrow(image, len(row_px))
    samples = np.arange(*PROFILE) + 0.5
    flat = _flat(narrow, row_px + (samples * (PROFILE_STEP_MM / mm_per_px[1]))[:, None])
    dark, bright = np.percentile(narrow, (DARK_PERCENT, BRIGHT_PERCENT))
    return flat, (float(dark), float(bright))


def averaged(grey: FloatImage, levels: tuple[float, float], column_mm: float, is_likely: Mask) -> FloatImage:
    """Return the profiles, (n, values), of a strip whose columns are so wide; 0 where there is no border."""
    dark, bright = levels
    relative = (np.asarray(grey, np.float32) - np.float32(dark)) / np.float32(max(bright - dark, 1.0))
    halves = (max(MIN_ALONG_COLUMNS, round(width_mm / column_mm)) for width_mm in PROFILE_WIDTHS_MM)
    means = [cv2.blur(relative, (2 * half + 1, 1), borderType=cv2.BORDER_REPLICATE) for half in halves]
    return np.ascontiguousarray(np.concatenate(means).T * is_likely[:, None], np.float32)


def _mean_along(
    narrow: Image, row_px: Floats, axial_mm: float, half: int, span: tuple[int, int]
) -> FloatImage:
    """Return the mean grey from one sample to another below a border, averaged along it, (n,)."""
    samples = np.arange(*span) + 0.5
    flat = _flat(narrow, row_px + (samples * (STEP_MM / axial_mm))[:, None])
    size = 2 * half + 1, 1
    return np.asarray(cv2.blur(flat.mean(axis=0)[None], size, borderType=cv2.BORDER_REPLICATE)[0], np.float32)


def _rise(image: Image, row_px: Floats, mm_per_px: Vec) -> Floats:
    """Return the rise of grey from `SEARCHED` samples above a border to `NEAR` below it, (samples, n)."""
    samples = np.arange(-SEARCHED - AVERAGED, NEAR + AVERAGED) + 0.5
    narrow = _narrow(image, len(row_px))
    flat = _flat(narrow, row_px + (samples * (STEP_MM / mm_per_px[1]))[:, None])
    half = _half_columns(image, row_px, mm_per_px)
    means = cv2.blur(flat, (2 * half + 1, AVERAGED), anchor=(half, 0), borderType=cv2.BORDER_REPLICATE)
    return np.asarray(means[AVERAGED : -AVERAGED + 1] - means[: -2 * AVERAGED + 1], np.float64)


def _narrow(image: Image, columns: int) -> Image:
    """Average the grey of an image to so many columns."""
    size = columns, image.shape[0]
    return np.asarray(cv2.resize(grey_of(image), size, interpolation=cv2.INTER_AREA), np.uint8)


def _flat(narrow: Image, rows: Floats) -> FloatImage:
    """Return the grey at rows of each column, (samples, n)."""
    across = np.broadcast_to(np.arange(rows.shape[1], dtype=np.float32), rows.shape)
    border = cv2.BORDER_REPLICATE
    flat = cv2.remap(
        narrow.astype(np.float32), across, rows.astype(np.float32), cv2.INTER_LINEAR, borderMode=border
    )
    return np.asarray(flat, np.float32)


def _half_columns(image: Image, row_px: Floats, mm_per_px: Vec) -> int:
    """Return the number of columns averaged on either side."""
    columns_mm = image.shape[1] * mm_per_px[0] / len(row_px)
    return max(MIN_ALONG_COLUMNS, round(ALONG_MM / float(columns_mm)))
