"""Images from a video file, by its own time."""

from pathlib import Path

import cv2
import numpy as np

from haptigraph.errors import BadInput, EndOfSource
from haptigraph.messages import Capture, Fault
from haptigraph.sources.opencv import open_capture

__all__ = ["VideoSource"]


class VideoSource:
    """Read a video with OpenCV.

    Args:
        path: The file.

    Raises:
        BadInput: If it does not exist or is no video.
    """

    is_live = False
    registration = None

    def __init__(self, path: str | Path) -> None:
        self._path = Path(path)
        if not self._path.is_file():
            raise BadInput("no such file", path)
        self._video = open_capture(str(path))
        self._expected = int(self._video.get(cv2.CAP_PROP_FRAME_COUNT))
        self.rate_hz = self._video.get(cv2.CAP_PROP_FPS)
        if not self._video.isOpened() or not self.rate_hz > 0:
            raise BadInput("not a video that OpenCV can read; MP4, AVI, MKV and MOV are", path)
        self._index = -1
        self._last_ns = -1
        self._ended = False

    def read(self, timeout_s: float) -> Capture | None:
        """Return the next image."""
        if self._ended:
            raise EndOfSource
        there, image = self._video.read()
        if there:
            self._index += 1
            return Capture(self._index, self._stamp_ns(), np.asarray(image, np.uint8))
        self._ended = True
        if self._index < 0:
            raise BadInput("has no image that can be decoded", self._path)
        if self._index + 1 < self._expected - 1:  # the count in the header may be one too many
            message = f"{self._path} breaks off after {self._index + 1} of {self._expected} images"
            return Capture(self._index, self._last_ns + 1, None, faults=(Fault("source", message),))
        raise EndOfSource

    def close(self) -> None:
        """Close the file."""
        self._video.release()

    def _stamp_ns(self) -> int:
        stamp_ns = round(self._video.get(cv2.CAP_PROP_POS_MSEC) * 1e6)
        if stamp_ns <= self._last_ns:  # some containers carry no times
            stamp_ns = self._last_ns + round(1e9 / self.rate_hz)
        self._last_ns = stamp_ns
        return stamp_ns
