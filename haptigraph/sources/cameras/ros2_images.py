"""Convert ROS 2 images, from a network or a bag, to arrays; reject anything but valid images of one size."""

import struct
from typing import Any

import numpy as np

from haptigraph.messages import Image
from haptigraph.recording.codec import decode

__all__ = ["compressed_image", "image_size_px", "raw_image"]

CHANNELS = {"mono8": 1, "8UC1": 1, "bgr8": 3, "8UC3": 3, "rgb8": 3, "bgra8": 4, "rgba8": 4}
BLUE_FIRST = {"rgb8": (2, 1, 0), "rgba8": (2, 1, 0), "bgra8": (0, 1, 2)}


def raw_image(message: Any, size_px: tuple[int, int]) -> Image:
    """Return the pixels of a sensor_msgs/Image, grey or BGR.

    Args:
        message: Any encoding of 8 bits per channel; the fields of ROS, whichever library decoded it.
        size_px: The required width and height.

    Raises:
        ValueError: If the message is not such an image.
    """
    channels = CHANNELS.get(message.encoding)
    if channels is None:
        raise ValueError(f"encoding {message.encoding[:40]!r}; supported are {', '.join(CHANNELS)}")
    _check_size((message.width, message.height), size_px)
    row, rows = message.width * channels, message.height
    if message.step < row or len(message.data) != message.step * rows:
        raise ValueError(
            f"{len(message.data)} bytes in rows of {message.step}; "
            f"{message.width} x {rows} px in {message.encoding} needs {rows} rows of at least {row}"
        )
    pixels = np.frombuffer(message.data, np.uint8).reshape(rows, message.step)[:, :row]
    if channels == 1:
        return np.ascontiguousarray(pixels)
    pixels = pixels.reshape(rows, message.width, channels)
    order = BLUE_FIRST.get(message.encoding)
    return np.ascontiguousarray(pixels if order is None else pixels[:, :, order])


def compressed_image(message: Any, size_px: tuple[int, int]) -> Image:
    """Return the pixels of a sensor_msgs/CompressedImage in JPEG or PNG, grey or BGR.

    The size in the file's header is checked before decoding, so that a few bytes cannot allocate gigabytes.

    Raises:
        ValueError: If the message is not such an image, or has another size.
    """
    _check_size(image_size_px(message), size_px)
    image = decode(bytes(message.data))
    _check_size((image.shape[1], image.shape[0]), size_px)
    return image


def image_size_px(message: Any) -> tuple[int, int]:
    """Return the width and height that an Image or CompressedImage claims, without decoding it.

    Raises:
        ValueError: If the bytes of a compressed image are neither JPEG nor PNG.
    """
    if hasattr(message, "encoding"):
        return int(message.width), int(message.height)
    size_px = _header_size_px(bytes(message.data))
    if size_px is None:
        raise ValueError(f"{len(message.data)} bytes that are neither JPEG nor PNG")
    return size_px


def _check_size(found_px: tuple[int, int], expected_px: tuple[int, int]) -> None:
    if found_px != expected_px:
        found, expected = ("{} x {} px".format(*size_px) for size_px in (found_px, expected_px))
        raise ValueError(f"an image of {found} instead of {expected}, as registered or first seen")


def _header_size_px(data: bytes) -> tuple[int, int] | None:
    """Read width and height from the header of a JPEG or PNG file."""
    if data.startswith(b"\x89PNG\r\n\x1a\n") and len(data) >= 24:
        width, height = struct.unpack(">II", data[16:24])
        return width, height
    if not data.startswith(b"\xff\xd8"):
        return None
    at = 2
    while at + 9 <= len(data) and data[at] == 0xFF:
        marker, length = data[at + 1], int.from_bytes(data[at + 2 : at + 4], "big")
        if 0xC0 <= marker <= 0xCF and marker not in (0xC4, 0xC8, 0xCC):  # SOF: start of frame
            height, width = struct.unpack(">HH", data[at + 5 : at + 9])
            return width, height
        at += 2 + length
    return None
