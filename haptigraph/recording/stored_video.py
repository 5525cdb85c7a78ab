"""The video that a recording contains: whether to store one, and its images, by number, in order or not."""

import os
import threading
import zlib
from pathlib import Path

import cv2
import numpy as np
from mcap.records import AttachmentIndex

from haptigraph.messages import Image
from haptigraph.opencv import open_capture, open_part
from haptigraph.recording.attachments import AttachedFile
from haptigraph.recording.scan import FOOTER, MAGIC, scan_between

__all__ = [
    "StoredVideo",
    "crc_of_pixels",
    "decoder_name",
    "is_smaller_than_images",
    "png_bytes",
    "video_at_the_end",
]

NEAR = 32  # images that are decoded one by one rather than sought
PNG_SHARE = 0.4  # of the bytes of its pixels: an image of an eye, as PNG


def crc_of_pixels(image: Image) -> int:
    """Return a checksum of an image."""
    return zlib.crc32(np.ascontiguousarray(image).data)


def decoder_name() -> str:
    """Return what decodes videos here, for messages."""
    return f"OpenCV {cv2.__version__}"


def png_bytes(height: float, width: float, channels: int = 3) -> int:
    """Estimate the size of an image as PNG."""
    return round(height * width * channels * PNG_SHARE)


def is_smaller_than_images(path: Path) -> bool:
    """Return whether a video takes less space than all of its images would as PNG, as far as it says so."""
    video = open_capture(str(path))
    properties = cv2.CAP_PROP_FRAME_COUNT, cv2.CAP_PROP_FRAME_WIDTH, cv2.CAP_PROP_FRAME_HEIGHT
    images, width, height = (video.get(which) for which in properties)
    video.release()
    return path.stat().st_size <= images * png_bytes(height, width)


def video_at_the_end(path: Path) -> "StoredVideo | None":
    """Return the video that a complete recording has behind its steps, from its index; None: it has none.

    Raises:
        BadInput: If the index cannot be read.
    """
    with path.open("rb") as file:
        end = file.seek(-len(MAGIC), os.SEEK_END)
        file.seek(-FOOTER.size, os.SEEK_CUR)
        _, _, start, _, _ = FOOTER.unpack(file.read(FOOTER.size))
    for piece in scan_between(path, start, end):
        for index in (record for record in piece.records if isinstance(record, AttachmentIndex)):
            place = index.offset, index.offset + index.length
            for found in scan_between(path, *place, verifies_attachments=False):
                return next(
                    (StoredVideo(each) for each in found.records if isinstance(each, AttachedFile)), None
                )
    return None


class StoredVideo:
    """The images of a video in a recording. Thread-safe.

    Args:
        file: Where the video is.
    """

    def __init__(self, file: AttachedFile) -> None:
        self.file = file
        self._lock = threading.Lock()
        self._video: cv2.VideoCapture | None = None
        self._next = 0
        """Number of the image that is decoded next."""
        self._is_counted = True
        """Whether that number was counted from the beginning, rather than sought."""

    def image(self, number: int, crc32: int) -> tuple[Image, bool]:
        """Return an image, and whether it has the given checksum.

        Images in order are the fastest. OpenCV does not always find the image that it is asked for; where the
        checksum differs, all images up to it are decoded.

        Args:
            number: Of the image, from 0.
            crc32: Its checksum, see `crc_of_pixels`.

        Raises:
            ValueError: If it cannot be decoded.
        """
        with self._lock:
            if not self._next <= number <= self._next + NEAR:
                self._seek(number)
            image = self._read(number)
            if image is not None and crc_of_pixels(image) == crc32:
                return image, True
            if not self._is_counted:
                self._open()
                image = self._read(number)
            if image is None:
                raise ValueError(f"{self.file.name} has no image {number} that {decoder_name()} can decode")
            return image, crc_of_pixels(image) == crc32

    def close(self) -> None:
        """Close the file. May be called twice."""
        with self._lock:
            if self._video is not None:
                self._video.release()
                self._video = None
            self._next, self._is_counted = 0, True

    def _open(self) -> cv2.VideoCapture:
        if self._video is not None:
            self._video.release()
        self._video = open_part(self.file.path, self.file.start, self.file.size)
        self._next, self._is_counted = 0, True
        return self._video

    def _seek(self, number: int) -> None:
        video = self._video or self._open()
        video.set(cv2.CAP_PROP_POS_FRAMES, number)
        self._next, self._is_counted = number, False

    def _read(self, number: int) -> Image | None:
        video = self._video or self._open()
        while self._next < number and video.grab():
            self._next += 1
        has_image, image = video.read() if self._next == number else (False, None)
        if not has_image or image is None:
            self._is_counted = False  # at the end, what comes next is undefined
            return None
        self._next += 1
        return np.asarray(image, np.uint8)
