"""A folder of volumes, one .npz file each, read one at a time and in the order of their time stamps."""

import math
import zipfile
import zlib
from collections.abc import Sequence
from pathlib import Path
from typing import Any, overload

import numpy as np
from numpy.typing import NDArray

from haptigraph.errors import BadInput
from haptigraph.perception.instrument.rotations import Array
from haptigraph.perception.native.volume import MAX_ROWS, MAX_SIDE, ROWS_PER_CELL

__all__ = ["VolumeFolder"]

NAMES = "<seconds>.npz, for example 1565077565.98.npz"


class VolumeFolder(Sequence[NDArray[np.uint8]]):
    """Volumes in a folder; each access reads the file.

    Args:
        folder: With files that are named by the second at which they were taken: `data` is a volume (rows,
            slices, columns) of uint8, `pos`, if any, the labelled pose: position [mm] and three angles [deg].

    Raises:
        BadInput: If there are none, or a name is no time stamp.
    """

    def __init__(self, folder: str | Path, files: "list[tuple[float, Path]] | None" = None) -> None:
        self.folder = Path(folder)
        if not self.folder.is_dir():
            raise BadInput("is not a folder", folder)
        if files is None:
            files = sorted((_seconds(file), file) for file in self.folder.glob("*.npz"))
        if not files:
            raise BadInput(f"has no volumes; valid: files named {NAMES}", folder)
        self._files = files
        self._shape: tuple[int, ...] | None = None

    def __len__(self) -> int:
        return len(self._files)

    @property
    def seconds(self) -> Array:
        """Return when each volume was taken, (n,)."""
        return np.array([seconds for seconds, _ in self._files])

    def name(self, number: int) -> str:
        """Return the name of a volume's file."""
        return self._files[number][1].name

    @overload
    def __getitem__(self, number: int) -> NDArray[np.uint8]: ...
    @overload
    def __getitem__(self, number: slice) -> "VolumeFolder": ...
    def __getitem__(self, number: "int | slice") -> "NDArray[np.uint8] | VolumeFolder":
        if isinstance(number, slice):
            return VolumeFolder(self.folder, self._files[number])
        path = self._files[number][1]
        volume = _read(path, "data")
        if volume.dtype != np.uint8 or volume.ndim != 3 or not _has_valid_sides(volume.shape):
            limits = f"{2 * ROWS_PER_CELL} to {MAX_ROWS} rows, 2 to {MAX_SIDE} slices and columns"
            found = f"{volume.dtype} of shape {volume.shape}"
            raise BadInput(
                f"data: expected uint8 of shape (rows, slices, columns), {limits}; found {found}", path
            )
        if self._shape is None:
            self._shape = volume.shape
        if volume.shape != self._shape:
            raise BadInput(
                f"data: expected shape {self._shape} as in other files; found {volume.shape}", path
            )
        return volume

    def labels(self) -> Array:
        """Return the labelled poses, (n, 6).

        Raises:
            BadInput: If a file has none.
        """
        return np.array([_label(path) for _, path in self._files])


def _seconds(file: Path) -> float:
    try:
        seconds = float(file.stem)
    except ValueError:
        seconds = math.nan
    if not math.isfinite(seconds):
        raise BadInput(f"the name is not a time stamp; valid: {NAMES}", file)
    return seconds


def _label(path: Path) -> Array:
    label = _read(path, "pos")
    if label.shape != (6,) or label.dtype.kind not in "fiu" or not np.isfinite(label).all():
        found = f"{label.dtype} of shape {label.shape}"
        raise BadInput(f"pos: expected six finite numbers, mm and degrees; found {found}", path)
    return label.astype(np.float64)


def _has_valid_sides(shape: tuple[int, ...]) -> bool:
    rows, slices, columns = shape
    return 2 * ROWS_PER_CELL <= rows <= MAX_ROWS and 2 <= slices <= MAX_SIDE and 2 <= columns <= MAX_SIDE


def _read(path: Path, name: str) -> "np.ndarray[Any, Any]":
    try:
        with Path(path).open("rb") as stream, np.load(stream, allow_pickle=False) as file:
            array = file[name]
    except KeyError:
        raise BadInput(f"has no array {name!r}", path) from None
    except (
        OSError,
        ValueError,
        EOFError,
        TypeError,
        AttributeError,
        zipfile.BadZipFile,
        zlib.error,
    ) as error:
        raise BadInput(f"is not a readable .npz file ({error})", path) from None
    return np.asarray(array)
