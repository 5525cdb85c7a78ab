"""Crop every image of another source, for instance to the B-scan in a video of a monitor."""

from typing import TypeAlias

import numpy as np
from msgspec.structs import replace

from haptigraph.errors import BadInput
from haptigraph.messages import Capture
from haptigraph.sources.wrapper import SourceWrapper
from haptigraph.stages import Source

__all__ = ["Box", "CropSource"]

Box: TypeAlias = tuple[int, int, int, int]
"""Left, top, width, height [px]."""


class CropSource(SourceWrapper):
    """Crop every image of a source.

    Args:
        source: The source.
        box: The region to keep.
        name: Of the source, for errors.
    """

    def __init__(self, source: Source, box: Box, name: str) -> None:
        super().__init__(source)
        self.registration = None  # the source's own is for the whole image
        self.depth_camera = None
        self._box, self._name = box, name

    def read(self, timeout_s: float) -> Capture | None:
        """Return the next capture, cropped.

        Raises:
            BadInput: If the region exceeds the image.
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
        return replace(capture, image=part, encoded=None, depth=None)
