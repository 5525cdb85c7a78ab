"""Images from a video file, with its own time stamps.

OpenCV reads the container's stamp of every image, also at a variable rate, and applies the container's
rotation (decision 0011).
"""

from pathlib import Path

import cv2
import numpy as np

from haptigraph.errors import BadInput, EndOfSource
from haptigraph.messages import Capture, Fault
from haptigraph.opencv import open_capture
from haptigraph.stages import Source

__all__ = ["VideoSource"]


class VideoSource(Source):
    """Read a video with OpenCV.

    Args:
        path: The file.

    Raises:
        BadInput: If the file does not exist or is not a video.
    """

    is_live = False

    def __init__(self, path: str | Path) -> None:
        self._path = Path(path)
        if not self._path.is_file():
            raise BadInput("no such file", path)
        self._video = open_capture(str(path))
        self._expected = self._video.get(cv2.CAP_PROP_FRAME_COUNT)
        self.rate_hz = self._video.get(cv2.CAP_PROP_FPS)
        if not self._video.isOpened() or not self.rate_hz > 0:
            raise BadInput("not a video that OpenCV can read; convert it to MP4, AVI, MKV or MOV", path)
        self._index = -1
        self._first_ns = self._last_ns = self._longest_ns = 0
        self._ended = False

    def read(self, timeout_s: float) -> Capture | None:
        """Return the next image."""
        if self._ended:
            raise EndOfSource
        has_image, image = self._video.read()
        if has_image:
            self._index += 1
            return Capture(self._index, self._stamp_ns(), np.asarray(image, np.uint8))
        self._ended = True
        if self._index < 0:
            raise BadInput("contains no image that OpenCV can decode", self._path)
        if self._is_truncated():
            message = f"{self._path} is truncated after {self._index + 1} of {self._expected:.0f} images"
            return Capture(self._index, self._last_ns + 1, None, faults=(Fault("source", message),))
        raise EndOfSource

    def close(self) -> None:
        """Close the file."""
        self._video.release()

    def _stamp_ns(self) -> int:
        """Return the time stamp of the image just read [ns], from 0."""
        in_file_ns = round(self._video.get(cv2.CAP_PROP_POS_MSEC) * 1e6)
        if not self._index:
            self._first_ns = in_file_ns
            self._expected -= max(self._video.get(cv2.CAP_PROP_PTS), 0)  # a file may start at a later stamp
            return 0
        stamp_ns = in_file_ns - self._first_ns
        if stamp_ns <= self._last_ns:  # some containers have no time stamps
            stamp_ns = self._last_ns + round(1e9 / self.rate_hz)
        self._longest_ns = max(self._longest_ns, stamp_ns - self._last_ns)
        self._last_ns = stamp_ns
        return stamp_ns

    def _is_truncated(self) -> bool:
        """Return whether images are missing at the end, by their number and by their time.

        If the file does not state the number of images, OpenCV derives it from the duration, and the last
        image may be shown for long; otherwise the number may be one too high.
        """
        missing_ns = self._expected / self.rate_hz * 1e9 - self._last_ns
        return self._index + 1 < self._expected - 1 and missing_ns > max(2e9 / self.rate_hz, self._longest_ns)
