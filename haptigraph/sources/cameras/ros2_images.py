"""Turn ROS 2's images into arrays, and refuse, in one sentence, what is no image of the registered size."""

import struct

import numpy as np

from haptigraph.messages import Image
from haptigraph.recording.codec import decode
from haptigraph.ros2 import types

__all__ = ["compressed_image", "raw_image"]

CHANNELS = {"mono8": 1, "8UC1": 1, "bgr8": 3, "8UC3": 3, "rgb8": 3, "bgra8": 4, "rgba8": 4}
BLUE_FIRST = {"rgb8": (2, 1, 0), "rgba8": (2, 1, 0), "bgra8": (0, 1, 2)}


def raw_image(message: types.Image, size_px: tuple[int, int]) -> Image:
    """Return the pixels of a sensor_msgs/Image, grey or BGR.

    Args:
        message: Any encoding of 8 bits per channel.
        size_px: Width and height it must have.

    Raises:
        ValueError: If it is something else.
    """
    channels = CHANNELS.get(message.encoding)
    if channels is None:
        raise ValueError(f"encoding {message.encoding[:40]!r}; read are {', '.join(CHANNELS)}")
    _check_size((message.width, message.height), size_px)
    row, rows = message.width * channels, message.height
    if message.step < row or len(message.data) != message.step * rows:
        raise ValueError(
            f"{len(message.data)} bytes in rows of {message.step}; "
            f"{message.width} x {rows} in {message.encoding} takes {rows} rows of at least {row}"
        )
    pixels = np.frombuffer(message.data, np.uint8).reshape(rows, message.step)[:, :row]
    if channels == 1:
        return np.ascontiguousarray(pixels)
    pixels = pixels.reshape(rows, message.width, channels)
    order = BLUE_FIRST.get(message.encoding)
    return np.ascontiguousarray(pixels if order is None else pixels[:, :, order])


def compressed_image(message: types.CompressedImage, size_px: tuple[int, int]) -> Image:
    """Return the pixels of a sensor_msgs/CompressedImage in JPEG or PNG, grey or BGR.

    Its size is read before it is decoded, so that a few bytes cannot ask for gigabytes.

    Raises:
        ValueError: If it is something else, or of another size.
    """
    told_px = _size_told(message.data)
    if told_px is None:
        raise ValueError(f"{len(message.data)} bytes that are neither JPEG nor PNG")
    _check_size(told_px, size_px)
    image = decode(message.data)
    _check_size((image.shape[1], image.shape[0]), size_px)
    return image


def _check_size(found_px: tuple[int, int], wanted_px: tuple[int, int]) -> None:
    if found_px != wanted_px:
        raise ValueError(f"{found_px[0]} x {found_px[1]} px; registered are {wanted_px[0]} x {wanted_px[1]}")


def _size_told(data: bytes) -> tuple[int, int] | None:
    """Read width and height from the header of a JPEG or PNG."""
    if data.startswith(b"\x89PNG\r\n\x1a\n") and len(data) >= 24:
        width, height = struct.unpack(">II", data[16:24])
        return width, height
    if not data.startswith(b"\xff\xd8"):
        return None
    at = 2
    while at + 9 <= len(data) and data[at] == 0xFF:
        marker, length = data[at + 1], int.from_bytes(data[at + 2 : at + 4], "big")
        if 0xC0 <= marker <= 0xCF and marker not in (0xC4, 0xC8, 0xCC):  # a frame's header
            height, width = struct.unpack(">HH", data[at + 5 : at + 9])
            return width, height
        at += 2 + length
    return None
