"""OCT volumes, one capture each: from DICOM, vendors' files, TIFF stacks and NumPy arrays.

A file is one volume, a folder a series of them in natural order. A volume becomes an image of its B-scans
side by side, (rows, slices * columns), which everything downstream transports like any other image.
"""

from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from haptigraph.config import SourceConfig
from haptigraph.errors import BadInput, EndOfSource
from haptigraph.imaging import UPRIGHT, grey_of
from haptigraph.messages import Capture, Image, Volume
from haptigraph.sources.depth import DeepDecoder, pages
from haptigraph.sources.images import natural
from haptigraph.sources.oct.dicom import DicomSource
from haptigraph.sources.oct.scan import ScanFacts, dicom_facts
from haptigraph.sources.reading import read_images
from haptigraph.stages import Source

__all__ = ["VolumesSource", "volume_files"]

NUMPY, TIFF, DICOM = (".npy", ".npz"), (".tif", ".tiff"), (".dcm", ".dicom")
WORDS = "slices", "rows", "columns"


def volume_files(path: Path) -> list[Path]:
    """Return the files of volumes that a path names: of NumPy, TIFF stacks, or in a folder also DICOM."""
    if not path.is_dir():
        is_stack = path.suffix.lower() in NUMPY or (path.is_file() and pages(path) > 1)
        return [path] if is_stack else []
    inside = sorted(path.iterdir(), key=lambda file: natural(file.name))
    for suffixes in (NUMPY, TIFF, DICOM):
        files = [file for file in inside if file.suffix.lower() in suffixes]
        if files and (suffixes is not TIFF or pages(files[0]) > 1):
            return files
    return []


class VolumesSource(Source):
    """Play volumes.

    Args:
        files: One volume each, in order.
        settings: Rate, depth, axes of arrays, and whether the B-scans are played one by one.
        facts: What the first file states, where it is known already.
        bscans: Those of the first file, where it is open already.

    Raises:
        BadInput: If the first file cannot be read, or the images are to be cropped or turned.
    """

    is_live = False

    def __init__(
        self,
        files: list[Path],
        settings: SourceConfig,
        facts: ScanFacts | None = None,
        bscans: Source | None = None,
    ) -> None:
        self._files, self._settings, self._decoder = files, settings, DeepDecoder(settings.bits)
        self.rate_hz = settings.rate_hz
        self._number = -1
        if settings.crop_px or settings.turn != UPRIGHT:
            raise BadInput(
                "volumes can be neither cropped nor turned; remove source.crop_px, source.rotate_deg and "
                "source.mirror",
                files[0],
            )
        self._first: Volume | None = self._load(files[0]) if bscans is None else _stack(bscans)
        self.facts = facts or _facts(files[0], len(self._first))
        self.size_px = self._first.shape[2], self._first.shape[1]
        """(width, height) of a B-scan."""
        self.slices = len(self._first)
        self._bscans = self._each() if settings.volume_as_sequence else None

    def read(self, timeout_s: float) -> Capture | None:
        """Return the next volume, or B-scan.

        Raises:
            BadInput: If a file cannot be read.
        """
        self._number += 1
        image = next(self._bscans, None) if self._bscans else self._next_volume()
        if image is None:
            raise EndOfSource
        return Capture(self._number, round(self._number * 1e9 / self.rate_hz), image)

    def close(self) -> None:
        """Do nothing: no file stays open."""

    def _next_volume(self) -> Image | None:
        volume, self._first = self._first, None
        if volume is None and self._number < len(self._files):
            volume = self._load(self._files[self._number])
        return None if volume is None else np.concatenate(list(volume), axis=1)

    def _each(self) -> Iterator[Image]:
        first, self._first = self._first, None
        for file in self._files:
            yield from self._load(file) if first is None else first
            first = None

    def _load(self, file: Path) -> Volume:
        """Return a file's volume, (slices, rows, columns)."""
        suffix = file.suffix.lower()
        if suffix in NUMPY:
            stored = _array(file)
            order = [self._settings.volume_axes.split(",").index(word) for word in WORDS]
            return self._in_8_bits(stored.transpose(order), file)
        if suffix in TIFF:
            is_read, stack = cv2.imreadmulti(str(file), flags=cv2.IMREAD_GRAYSCALE | cv2.IMREAD_ANYDEPTH)
            if not is_read or len({page.shape for page in stack}) != 1:
                raise BadInput("not a stack of B-scans of one size that OpenCV can read", file)
            return self._in_8_bits(np.stack(stack), file)
        return _stack(DicomSource(file, self.rate_hz))

    def _in_8_bits(self, stored: NDArray[Any], file: Path) -> Volume:
        try:
            return np.ascontiguousarray(self._decoder.in_8_bits(stored))
        except BadInput as error:
            raise BadInput(error.problem, file) from None


def _stack(bscans: Source) -> Volume:
    """Return all B-scans of a source, (slices, rows, columns), and close it."""
    with closing(read_images(bscans)) as captures:
        return np.stack([grey_of(capture.image) for capture in captures if capture.image is not None])


def _array(file: Path) -> NDArray[Any]:
    """Return the only array of three axes in a NumPy file."""
    try:
        with file.open("rb") as opened:  # NumPy leaves a damaged file open
            loaded = np.load(opened, allow_pickle=False)
            arrays = [loaded] if isinstance(loaded, np.ndarray) else list(loaded.values())
    except OSError as error:
        raise BadInput(f"cannot be read ({error.strerror or error})", file) from None
    except Exception as error:  # NumPy and zipfile raise anything for a damaged file
        raise BadInput(f"not a NumPy file ({' '.join(str(error).split())})", file) from None
    volumes = [array for array in arrays if array.ndim == 3]
    if len(volumes) != 1:
        shapes = ", ".join(str(array.shape) for array in arrays) or "none"
        raise BadInput(f"expected one array of three axes, a volume; found {shapes}", file)
    return volumes[0]


def _facts(file: Path, count: int) -> ScanFacts:
    if file.suffix.lower() in DICOM:
        return dicom_facts(file)
    return ScanFacts(volume_reason=f"it contains {count} B-scans")
