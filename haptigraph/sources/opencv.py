"""Open cameras and videos through OpenCV without its chatter; haptigraph says itself what is wrong."""

import os

import cv2

__all__ = ["open_capture"]


def open_capture(what: int | str) -> cv2.VideoCapture:
    """Open a camera by number or a video by path; ask `isOpened()` whether that worked."""
    os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")
    level = cv2.utils.logging.getLogLevel()
    cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)
    try:
        return cv2.VideoCapture(what)
    finally:
        cv2.utils.logging.setLogLevel(level)
