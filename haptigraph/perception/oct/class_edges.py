"""The upper edge of a bright band, in the grey of an image near the border that a network found.

The outer retina has several bright bands, some 40 µm apart. A network may follow the wrong one with
confidence, over half an image; then an edge from dark to bright is visible above its border. And the image
locates such an edge more precisely than the classes do.
"""

import cv2
import numpy as np

from haptigraph.geometry import Vec
from haptigraph.imaging import Floats, Mask, grey_of
from haptigraph.messages import Image

__all__ = ["upper_edge"]

STEP_MM = 0.003  # between samples down a column; the next three are counts of samples
AVERAGED = 4  # on either side of an edge
NEAR = 5  # an edge at most so far below a border is its own; so near above it, none is counted
SEARCHED = 17  # above a border, for other edges
ALONG_MM, MIN_ALONG_COLUMNS = 0.2, 2  # averaged along a border, on either side
MAX_SHARE = 0.3  # contrast of other edges, relative to a border's own


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


def _rise(image: Image, row_px: Floats, mm_per_px: Vec) -> Floats:
    """Return the rise of grey from `SEARCHED` samples above a border to `NEAR` below it, (samples, n)."""
    columns, (height, width) = len(row_px), image.shape[:2]
    narrow = cv2.resize(grey_of(image), (columns, height), interpolation=cv2.INTER_AREA)
    samples = np.arange(-SEARCHED - AVERAGED, NEAR + AVERAGED) + 0.5
    rows = row_px + (samples * (STEP_MM / mm_per_px[1]))[:, None]
    across = np.broadcast_to(np.arange(columns, dtype=np.float32), rows.shape)
    flat = cv2.remap(
        narrow.astype(np.float32),
        across,
        rows.astype(np.float32),
        cv2.INTER_LINEAR,
        borderMode=cv2.BORDER_REPLICATE,
    )
    half = max(MIN_ALONG_COLUMNS, round(ALONG_MM * columns / (width * mm_per_px[0])))
    size = 2 * half + 1, AVERAGED
    means = cv2.blur(flat, size, anchor=(half, 0), borderType=cv2.BORDER_REPLICATE)
    return np.asarray(means[AVERAGED : -AVERAGED + 1] - means[: -2 * AVERAGED + 1], np.float64)
