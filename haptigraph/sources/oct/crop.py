"""A part of every image of another source: the B-scan in the picture of a monitor, without what is around it.

Knows nothing of what the images show.
"""

from typing import TypeAlias

import numpy as np
from msgspec.structs import replace

from haptigraph.errors import BadInput
from haptigraph.messages import Capture
from haptigraph.stages import Source

__all__ = ["Box", "CropSource"]

Box: TypeAlias = tuple[int, int, int, int]
"""Left, top, width, height [px]."""


class CropSource:
    """Cut every image of a source.

    Args:
        source: Whose images; it is closed with this one.
        box: What remains of them.
        name: Of the source, for errors.
    """

    registration: str | None = None  # the source's own would be for the whole image

    def __init__(self, source: Source, box: Box, name: str) -> None:
        self._source, self._box, self._name = source, box, name
        self.rate_hz, self.is_live = source.rate_hz, source.is_live
        self.notes: tuple[str, ...] = (*getattr(source, "notes", ()),)

    def read(self, timeout_s: float) -> Capture | None:
        """Return the next image's part.

        Raises:
            BadInput: If the image is smaller than where the part would be.
        """
        capture = self._source.read(timeout_s)
        if capture is None or capture.image is None:
            return capture
        left, top, width, height = self._box
        rows, columns = capture.image.shape[:2]
        if left + width > columns or top + height > rows:
            raise BadInput(
                f"source.crop_px asks for {width} x {height} px from ({left}, {top}), "
                f"but the image is {columns} x {rows} px",
                self._name,
            )
        part = np.ascontiguousarray(capture.image[top : top + height, left : left + width])
        return replace(capture, image=part, encoded=None)

    def close(self) -> None:
        """Close the source."""
        self._source.close()
