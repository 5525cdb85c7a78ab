"""Open cameras and videos through OpenCV with its own log messages silenced."""

import os
from collections.abc import Sequence

import cv2

__all__ = ["open_capture"]

TIMEOUT_MS = 3000
STREAM_PARAMETERS = (  # only the FFmpeg backend has network timeouts
    cv2.CAP_PROP_OPEN_TIMEOUT_MSEC,
    TIMEOUT_MS,
    cv2.CAP_PROP_READ_TIMEOUT_MSEC,
    TIMEOUT_MS,
)


def open_capture(device: int | str) -> cv2.VideoCapture:
    """Open a camera by number, or a video by path or URL; `isOpened()` returns whether that worked."""
    os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")
    level = cv2.utils.logging.getLogLevel()
    cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)
    try:
        if isinstance(device, str) and "://" in device:
            parameters: Sequence[int] = STREAM_PARAMETERS
            return cv2.VideoCapture(device, cv2.CAP_FFMPEG, parameters)
        return cv2.VideoCapture(device)
    finally:
        cv2.utils.logging.setLogLevel(level)
