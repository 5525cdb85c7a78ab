"""Pictures of 8 or 16 bit as the 8 bit that perception sees. Knows no file format but those of OpenCV."""

from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from haptigraph.errors import BadInput
from haptigraph.messages import Image

__all__ = ["DeepDecoder", "pages"]

LEAST_USED = 2**13  # a picture of 16 bit whose brightest pixel is below probably holds fewer bits


class DeepDecoder:
    """Decode pictures; the scale from their depth to 8 bit is the same for all of them.

    Args:
        bits: How many bits a 16-bit file really uses; 0: all of them.
    """

    def __init__(self, bits: int = 0) -> None:
        self._bits = bits
        self._is_first = True

    def __call__(self, data: bytes) -> Image:
        """Return the picture in a file's bytes, grey or BGR.

        Raises:
            ValueError: If OpenCV cannot read it.
            BadInput: If its depth is none that is handled, or not the one that was said.
        """
        stored = _decoded(data)
        if stored.dtype == np.uint8:
            if self._bits not in (0, 8):
                raise BadInput(f"holds 8 bit, but source.bits says {self._bits}; leave source.bits out")
            return np.asarray(stored, np.uint8)
        if stored.dtype != np.uint16:
            raise BadInput(f"has pixels of kind {stored.dtype}; whole numbers of 8 or 16 bit are read")
        most, bits = int(stored.max()), self._bits or 16
        if most >= 2**bits:
            raise BadInput(f"has a pixel of {most}, more than the {bits} bit that source.bits says can hold")
        if self._is_first and not self._bits and most < LEAST_USED:
            raise BadInput(
                f"is 16 bit, but nothing in it is brighter than {most} of 65535; say how many bits are used, "
                f"probably --set source.bits={max(most.bit_length(), 8)}"
            )
        self._is_first = False
        return np.asarray(np.rint(stored * (255 / (2**bits - 1))), np.uint8)


def pages(file: Path) -> int:
    """Return how many pictures a file holds; only TIFF can hold several."""
    return cv2.imcount(str(file)) if file.suffix.lower() in (".tif", ".tiff") else 1


def _decoded(data: bytes) -> NDArray[Any]:
    try:
        stored = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_ANYCOLOR | cv2.IMREAD_ANYDEPTH)
    except cv2.error:
        stored = None
    if stored is None:
        raise ValueError(f"{len(data)} bytes that are no picture")
    return stored
