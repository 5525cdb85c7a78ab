"""Open cameras and videos through OpenCV with its own log messages silenced."""

import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import cv2

__all__ = ["open_capture", "open_part"]

TIMEOUT_MS = 3000
STREAM_PARAMETERS = (  # only the FFmpeg backend has network timeouts
    cv2.CAP_PROP_OPEN_TIMEOUT_MSEC,
    TIMEOUT_MS,
    cv2.CAP_PROP_READ_TIMEOUT_MSEC,
    TIMEOUT_MS,
)


def open_capture(device: int | str) -> cv2.VideoCapture:
    """Open a camera by number, or a video by path or URL; `isOpened()` returns whether that worked."""
    with _silence():
        if isinstance(device, str) and "://" in device:
            parameters: Sequence[int] = STREAM_PARAMETERS
            return cv2.VideoCapture(device, cv2.CAP_FFMPEG, parameters)
        return cv2.VideoCapture(device)


def open_part(path: Path, start: int, size: int) -> cv2.VideoCapture:
    """Open a video that is a part of a file; `isOpened()` returns whether that worked."""
    with _silence():
        part = f"subfile,,start,{start},end,{start + size},,:{path.absolute()}"
        return cv2.VideoCapture(part, cv2.CAP_FFMPEG)


@contextmanager
def _silence() -> Iterator[None]:
    os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")
    level = cv2.utils.logging.getLogLevel()
    cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)
    try:
        yield
    finally:
        cv2.utils.logging.setLogLevel(level)
