"""Open cameras and videos through OpenCV without its chatter; haptigraph says itself what is wrong."""

import os
from collections.abc import Sequence

import cv2

__all__ = ["open_capture"]

PATIENCE_MS = 3000
STREAM = (  # FFmpeg alone knows how long it may wait for a network
    cv2.CAP_PROP_OPEN_TIMEOUT_MSEC,
    PATIENCE_MS,
    cv2.CAP_PROP_READ_TIMEOUT_MSEC,
    PATIENCE_MS,
)


def open_capture(what: int | str) -> cv2.VideoCapture:
    """Open a camera by number or a video by path or address; ask `isOpened()` whether that worked."""
    os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")
    level = cv2.utils.logging.getLogLevel()
    cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)
    try:
        if isinstance(what, str) and "://" in what:
            parameters: Sequence[int] = STREAM
            return cv2.VideoCapture(what, cv2.CAP_FFMPEG, parameters)
        return cv2.VideoCapture(what)
    finally:
        cv2.utils.logging.setLogLevel(level)
