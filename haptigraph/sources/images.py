"""Read images from a folder, in natural order of their names, at a configured rate."""

import re
from collections.abc import Callable
from pathlib import Path

from haptigraph.errors import BadInput, EndOfSource
from haptigraph.messages import Capture, Image
from haptigraph.recording.codec import decode
from haptigraph.stages import Source

__all__ = ["SUFFIXES", "ImagesSource", "natural"]

SUFFIXES = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff")
"""Suffixes of the images that are read."""
RECORDABLE = (".png", ".jpg", ".jpeg")  # a recording stores these bytes unchanged


class ImagesSource(Source):
    """Read a folder.

    Args:
        folder: The folder, or a single image.
        rate_hz: Images per second.
        decode: Turns a file's bytes into an image, or raises ValueError.

    Raises:
        BadInput: If the folder has no images.
    """

    is_live = False

    def __init__(self, folder: str | Path, rate_hz: float, decode: Callable[[bytes], Image] = decode) -> None:
        self.rate_hz = rate_hz
        self._index, self._decode = -1, decode
        folder = Path(folder)
        inside = [folder] if folder.is_file() else folder.iterdir()
        files = (file for file in inside if file.suffix.lower() in SUFFIXES)
        self._files = sorted(files, key=lambda file: natural(file.name))
        if not self._files:
            raise BadInput(f"no images in the folder; supported are {', '.join(SUFFIXES)}", folder)

    def read(self, timeout_s: float) -> Capture | None:
        """Return the next image."""
        self._index += 1
        if self._index >= len(self._files):
            raise EndOfSource
        file = self._files[self._index]
        try:
            data = file.read_bytes()
            image = self._decode(data)
        except OSError as error:
            raise BadInput(f"cannot be read ({error.strerror})", file) from None
        except BadInput as error:
            raise BadInput(error.problem, file) from None
        except ValueError:
            raise BadInput("not an image that OpenCV can read", file) from None
        stamp_ns = round(self._index * 1e9 / self.rate_hz)
        encoded = data if file.suffix.lower() in RECORDABLE else None
        return Capture(self._index, stamp_ns, image, encoded)

    def close(self) -> None:
        """Do nothing: no file stays open."""


def natural(name: str) -> list[tuple[int, str]]:
    """Return the key that sorts names with numbers as people do: 2 before 10."""
    return [(int(part), "") if part.isdecimal() else (-1, part) for part in re.split(r"(\d+)", name)]
