"""Decode images of 8 or 16 bits per channel into the 8 bits that perception processes."""

from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from haptigraph.errors import BadInput
from haptigraph.messages import Image

__all__ = ["DeepDecoder", "pages"]

MIN_BRIGHTEST = 2**13  # a 16-bit image whose brightest pixel is below probably uses fewer bits


class DeepDecoder:
    """Decode images, all with the same scale from their depth to 8 bits.

    Args:
        bits: How many bits a 16-bit file really uses; 0: all of them.
    """

    def __init__(self, bits: int = 0) -> None:
        self._bits = bits
        self._is_first = True

    def __call__(self, data: bytes) -> Image:
        """Return the image in a file's bytes, grey or BGR.

        Raises:
            ValueError: If OpenCV cannot read it.
            BadInput: If its depth is not supported, or contradicts `bits`.
        """
        return self.in_8_bits(_decoded(data))

    def in_8_bits(self, stored: NDArray[Any]) -> Image:
        """Return stored values as 8 bits.

        Raises:
            BadInput: As above.
        """
        if stored.dtype == np.uint8:
            if self._bits not in (0, 8):
                raise BadInput(f"has 8 bits per pixel, but source.bits is {self._bits}; remove source.bits")
            return np.asarray(stored, np.uint8)
        if stored.dtype != np.uint16:
            raise BadInput(f"has pixels of type {stored.dtype}; supported are 8 and 16 bits, unsigned")
        brightest, bits = int(stored.max()), self._bits or 16
        if brightest >= 2**bits:
            raise BadInput(f"has a pixel of {brightest}, which needs more bits than source.bits={bits}")
        if self._is_first and not self._bits and brightest < MIN_BRIGHTEST:
            raise BadInput(
                f"has 16 bits per pixel, but none is brighter than {brightest} of 65535; set how many bits "
                f"are used, probably --set source.bits={max(brightest.bit_length(), 8)}"
            )
        self._is_first = False
        return np.asarray(np.rint(stored * (255 / (2**bits - 1))), np.uint8)


def pages(file: Path) -> int:
    """Return the number of images in a file; only TIFF can hold several."""
    return cv2.imcount(str(file)) if file.suffix.lower() in (".tif", ".tiff") else 1


def _decoded(data: bytes) -> NDArray[Any]:
    try:
        stored = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_ANYCOLOR | cv2.IMREAD_ANYDEPTH)
    except cv2.error:
        stored = None
    if stored is None:
        raise ValueError(f"{len(data)} bytes that are not an image")
    return stored
