"""The files of a LeRobot dataset: tables and videos that hold many episodes, up to a size.

Names, sizes and columns are those of format v3.0 (lerobot/datasets/utils.py of LeRobot 0.4).
"""

from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import msgspec
import numpy as np
from numpy.typing import NDArray

from haptigraph.analysis.plots.video_file import Encoding, VideoFile, new_video

if TYPE_CHECKING:
    import pyarrow as pa

__all__ = [
    "CHUNK_FILES",
    "DATA_MB",
    "VIDEO_MB",
    "DataFiles",
    "Place",
    "VideoFiles",
    "encoding",
    "write_tasks",
]

CHUNK_FILES, DATA_MB, VIDEO_MB = 1000, 100, 200
BYTES_PER_MB = 1 << 20
RANDOM_ACCESS = {"g": "2", "bf": "0"}
"""A key picture at every second one: a reader decodes at most two to get one."""


class Place(NamedTuple):
    """Which file, of those of one kind."""

    chunk: int
    file: int

    @classmethod
    def of(cls, number: int) -> "Place":
        """Return the place of a file by its number."""
        return cls(*divmod(number, CHUNK_FILES))

    def path(self, folder: Path, suffix: str) -> Path:
        """Return the file's path, whose folder exists."""
        path = folder / f"chunk-{self.chunk:03d}" / f"file-{self.file:03d}{suffix}"
        path.parent.mkdir(parents=True, exist_ok=True)
        return path


class DataFiles:
    """Tables of all steps of many episodes.

    Args:
        folder: Where they are.
    """

    def __init__(self, folder: Path) -> None:
        self._folder, self._number, self._open = folder, 0, ExitStack()
        self._writer: Any = None
        self._path = folder

    def write(self, table: "pa.Table") -> Place:
        """Append an episode, and return in which file it is."""
        from pyarrow import parquet  # noqa: PLC0415 - optional

        if self._writer is not None and self._path.stat().st_size > DATA_MB * BYTES_PER_MB:
            self.close()
            self._number += 1
        place = Place.of(self._number)
        if self._writer is None:
            self._path = place.path(self._folder, ".parquet")
            self._writer = self._open.enter_context(
                parquet.ParquetWriter(self._path, table.schema, compression="snappy")
            )
        self._writer.write_table(table)
        return place

    def close(self) -> None:
        """Complete the last file."""
        self._writer = None
        self._open.close()


class VideoFiles:
    """Videos of all images of many episodes, at a constant rate.

    Args:
        folder: Where they are.
        shape: Height, width and channels of every image [px].
        fps: Images in a second.
        encoding: How they are encoded.
    """

    def __init__(self, folder: Path, shape: tuple[int, int, int], fps: int, encoding: Encoding) -> None:
        self._folder, self._shape, self._fps, self._encoding = folder, shape, fps, encoding
        self._number, self._images, self._open = 0, 0, ExitStack()
        self._video: VideoFile | None = None

    def begin_episode(self) -> tuple[Place, float]:
        """Return in which file the next images are, and from which time [s] on."""
        if self._video is not None and self._video.size_bytes > VIDEO_MB * BYTES_PER_MB:
            self.close()
            self._number += 1
        return Place.of(self._number), self._images / self._fps

    def add(self, picture: NDArray[np.uint8]) -> None:
        """Append an image, (height, width, 3) RGB."""
        if self._video is None:
            height, width, _ = self._shape
            path = Place.of(self._number).path(self._folder, ".mp4")
            self._video = self._open.enter_context(new_video(path, width, height, self._fps, self._encoding))
        self._video.add(picture, self._images / self._fps)
        self._images += 1

    def close(self) -> None:
        """Complete the last file."""
        self._video, self._images = None, 0
        self._open.close()


def encoding(shape: tuple[int, int, int], fps: int, *, is_lossless: bool) -> Encoding:
    """Return how the images are encoded: as browsers play them, or without loss, for LeRobot alone.

    Args:
        shape: Height, width and channels of every image [px].
        fps: Images in a second.
        is_lossless: Whether every pixel is kept.
    """
    if is_lossless:
        options = {"libx264rgb": {"qp": "0", "preset": "veryfast", **RANDOM_ACCESS}}
        return Encoding({"libx264rgb": "H.264"}, options, "rgb24", fps)
    options = {"libx264": {"crf": "18", "preset": "veryfast", **RANDOM_ACCESS}}
    is_even = not (shape[0] % 2 or shape[1] % 2)
    return Encoding({"libx264": "H.264"}, options, "yuv420p" if is_even else "yuv444p", fps)


def write_tasks(path: Path, tasks: list[str]) -> None:
    """Write the tasks by number; pandas reads them with the task as the index, as LeRobot expects."""
    import pyarrow as pa  # noqa: PLC0415 - optional
    from pyarrow import parquet  # noqa: PLC0415 - optional

    table = pa.table({"task_index": pa.array(range(len(tasks)), pa.int64()), "task": pa.array(tasks)})
    columns = [
        {"name": "task_index", "field_name": "task_index", "pandas_type": "int64", "numpy_type": "int64"},
        {"name": "task", "field_name": "task", "pandas_type": "unicode", "numpy_type": "object"},
    ]
    about = {
        "index_columns": ["task"],
        "column_indexes": [],
        "columns": [{**each, "metadata": None} for each in columns],
    }
    parquet.write_table(table.replace_schema_metadata({"pandas": msgspec.json.encode(about)}), path)
