"""Write recorded runs as a LeRobot dataset, format v3.0: one episode a run, one row and one image a step.

The dataset names no participant, trial, file or date. LeRobot's `timestamp` is the number of the step divided
by the rate, as the format demands; the recorded time is `stamp_ns`.
"""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import cv2
import msgspec
import numpy as np
from numpy.typing import NDArray

from haptigraph.analysis.exporting.columns import Row, RunTable
from haptigraph.analysis.exporting.csv_table import write_dictionary
from haptigraph.analysis.exporting.lerobot.card import card
from haptigraph.analysis.exporting.lerobot.features import IMAGE
from haptigraph.analysis.exporting.lerobot.files import (
    CHUNK_FILES,
    DATA_MB,
    VIDEO_MB,
    DataFiles,
    Place,
    VideoFiles,
    encoding,
    write_tasks,
)
from haptigraph.analysis.exporting.lerobot.statistics import (
    ImageStatistics,
    Numbers,
    Statistics,
    of_values,
    over_all,
)
from haptigraph.analysis.exporting.lerobot.survey import Survey, survey_of
from haptigraph.errors import BadInput, MissingExtra
from haptigraph.recording.header import losses_sentence
from haptigraph.recording.writer import Progress
from haptigraph.sources.naming import is_simulated
from haptigraph.version import __version__

if TYPE_CHECKING:
    import pyarrow as pa

__all__ = ["write_lerobot"]

VERSION = "v3.0"
PATTERN = "chunk-{chunk_index:03d}/file-{file_index:03d}"
COUNTERS = {
    "timestamp": "float32",
    "frame_index": "int64",
    "episode_index": "int64",
    "index": "int64",
    "task_index": "int64",
}
"""The features of every dataset, by type."""
COUNTED = {
    "timestamp": ("s", "frame_index divided by the rate; the recorded time is stamp_ns"),
    "frame_index": ("", "number of the step in its episode"),
    "episode_index": ("", "number of the run in the dataset"),
    "index": ("", "number of the step in the dataset"),
    "task_index": ("", "the operation: meta/tasks.parquet"),
}


class _Episode(NamedTuple):
    """One recording in the dataset."""

    about: dict[str, Any]
    """Its row of `meta/episodes`."""
    statistics: dict[str, tuple[Statistics, Numbers]]
    """By feature, with the number of known values."""
    source: dict[str, Any]
    """What `meta/haptigraph.json` says of it."""


def write_lerobot(paths: Sequence[Path], folder: Path, progress: Progress, *, is_lossless: bool) -> str:
    """Write recordings as a dataset into an existing folder.

    Args:
        paths: The recordings, in the order of the episodes.
        folder: The dataset.
        progress: Called with the number of steps written, and of all.
        is_lossless: Whether every pixel is kept.

    Returns:
        A sentence for users.

    Raises:
        BadInput: If a recording cannot be read, they do not fit together, or there is no image.
        MissingExtra: If pyarrow or PyAV is not installed.
    """
    try:
        import av  # noqa: F401, PLC0415 - optional
        import pyarrow  # noqa: F401, PLC0415 - optional
    except ModuleNotFoundError:
        raise MissingExtra("an export for LeRobot", "lerobot") from None
    survey = survey_of(paths)
    dataset = _Dataset(folder, survey, progress, is_lossless=is_lossless)
    with dataset:
        for path in paths:
            dataset.add(RunTable(path, ""))
    dataset.write_about()
    return (
        f"episodes: {len(paths)}, steps: {survey.steps}; timestamps are up to {dataset.apart_s:.3f} s "
        "from the recorded times in stamp_ns; read README.md before you publish"
    )


class _Dataset:
    """The dataset while it is written; a context that completes tables and videos.

    Args:
        folder: An existing folder.
        survey: What it will contain.
        progress: Called with the number of steps written, and of all.
        is_lossless: Whether every pixel is kept.
    """

    def __init__(self, folder: Path, survey: Survey, progress: Progress, *, is_lossless: bool) -> None:
        self._folder, self._survey, self._progress, self._is_lossless = folder, survey, progress, is_lossless
        self._data = DataFiles(folder / "data")
        self._encoding = encoding(survey.shape, survey.fps, is_lossless=is_lossless)
        self._videos = VideoFiles(folder / "videos" / IMAGE, survey.shape, survey.fps, self._encoding)
        self._episodes: list[_Episode] = []
        self._written = 0
        self.apart_s = 0.0
        """The most by which a recorded time differs from a timestamp."""

    def __enter__(self) -> None:
        pass

    def __exit__(self, *_: object) -> None:
        self._data.close()
        self._videos.close()

    def add(self, table: RunTable) -> None:
        """Append a recording as an episode.

        Raises:
            BadInput: If it is damaged, or an image has another size.
        """
        video, from_s = self._videos.begin_episode()
        images, times_s = ImageStatistics(), list[float]()
        values: dict[str, list[Sequence[Any]]] = {feature.name: [] for feature in self._survey.features}
        has_truth = False
        for row in table.rows(images=True):
            self._videos.add(self._picture(table, row, images))
            times_s.append((row.step.stamp_ns - row.start_ns) / 1e9)
            has_truth |= row.capture.truth is not None
            for feature in self._survey.features:
                values[feature.name].append(feature.values(row))
            self._progress("writing", self._written + len(times_s), self._survey.steps)
        counters = self._counters(len(times_s))
        self.apart_s = max(self.apart_s, float(np.abs(counters["timestamp"] - times_s).max()))
        data = self._data.write(self._table(counters, values))
        statistics = {
            name: of_values(column[:, None].astype(np.float64)) for name, column in counters.items()
        }
        for feature in self._survey.features:
            if feature.dtype != "string":
                statistics[feature.name] = of_values(np.array(values[feature.name], np.float64))
        statistics[IMAGE] = images.result()
        about = {
            "episode_index": len(self._episodes),
            "tasks": [self._survey.task],
            "length": len(times_s),
            "dataset_from_index": self._written,
            "dataset_to_index": self._written + len(times_s),
            "data/chunk_index": data.chunk,
            "data/file_index": data.file,
            f"videos/{IMAGE}/chunk_index": video.chunk,
            f"videos/{IMAGE}/file_index": video.file,
            f"videos/{IMAGE}/from_timestamp": from_s,
            f"videos/{IMAGE}/to_timestamp": from_s + len(times_s) / self._survey.fps,
            "meta/episodes/chunk_index": 0,
            "meta/episodes/file_index": 0,
        }
        simulated = has_truth or is_simulated(table.reader.info.source)
        self._episodes.append(_Episode(about, statistics, _source(table, is_simulated=simulated)))
        self._written += len(times_s)

    def write_about(self) -> None:
        """Write what the folder `meta` says, the data dictionary and the card.

        Raises:
            BadInput: If no step of any recording has an image.
        """
        import pyarrow as pa  # noqa: PLC0415 - optional
        from pyarrow import parquet  # noqa: PLC0415 - optional

        if not any(episode.statistics[IMAGE][0]["count"][0] for episode in self._episodes):
            raise BadInput("no recording has an image; LeRobot's datasets need images")
        meta = self._folder / "meta"
        place = Place.of(0).path(meta / "episodes", ".parquet")
        parquet.write_table(pa.Table.from_pylist([_episode_row(each) for each in self._episodes]), place)
        write_tasks(meta / "tasks.parquet", [self._survey.task])
        _write_json(meta / "info.json", self._info())
        names = self._episodes[0].statistics
        statistics = {name: over_all([each.statistics[name] for each in self._episodes]) for name in names}
        _write_json(
            meta / "stats.json",
            {
                name: {key: value.tolist() for key, value in of_one.items()}
                for name, of_one in statistics.items()
            },
        )
        sources = [episode.source for episode in self._episodes]
        _write_json(meta / "haptigraph.json", {"exported_with": __version__, "episodes": sources})
        write_dictionary(self._folder / "data_dictionary.csv", self._dictionary())
        is_simulated = [source["simulated"] for source in sources]
        text = card(self._survey.task, self._survey.fps, is_simulated, is_lossless=self._is_lossless)
        (self._folder / "README.md").write_text(text, "utf-8")

    def _picture(self, table: RunTable, row: Row, images: ImageStatistics) -> NDArray[np.uint8]:
        """Return the image as (height, width, 3) RGB, black where there is none; count it if there is."""
        image = row.capture.image
        if image is None:
            return np.zeros(self._survey.shape, np.uint8)
        code = cv2.COLOR_GRAY2RGB if image.ndim == 2 else cv2.COLOR_BGR2RGB
        picture = np.asarray(cv2.cvtColor(image, code), np.uint8)
        if picture.shape != self._survey.shape:
            found, expected = (f"{shape[1]} x {shape[0]} px" for shape in (picture.shape, self._survey.shape))
            place = f"step {row.number}"
            raise BadInput(f"an image of {found} among images of {expected}", table.reader.path, place)
        images.add(picture)
        return picture

    def _counters(self, length: int) -> dict[str, NDArray[Any]]:
        number = np.arange(length)
        return {
            "timestamp": (number / self._survey.fps).astype(np.float32),
            "frame_index": number,
            "episode_index": np.full(length, len(self._episodes)),
            "index": self._written + number,
            "task_index": np.zeros(length, np.int64),
        }

    def _table(self, counters: dict[str, NDArray[Any]], values: dict[str, list[Sequence[Any]]]) -> "pa.Table":
        import pyarrow as pa  # noqa: PLC0415 - optional

        types = {"float32": pa.float32(), "int64": pa.int64(), "string": pa.string()}
        columns = {}
        for feature in self._survey.features:
            kind, width, rows = types[feature.dtype], len(feature.channels), values[feature.name]
            columns[feature.name] = (
                pa.array([row[0] for row in rows], kind)
                if width == 1
                else pa.array(rows, pa.list_(kind, width))
            )
        for name, column in counters.items():
            columns[name] = pa.array(column, types[COUNTERS[name]])
        return pa.table(columns)

    def _info(self) -> dict[str, Any]:
        height, width, _ = self._survey.shape
        video = {
            "video.height": height,
            "video.width": width,
            "video.codec": "h264",
            "video.pix_fmt": "gbrp" if self._is_lossless else self._encoding.pixels,
            "video.is_depth_map": False,
            "video.fps": self._survey.fps,
            "video.channels": 3,
            "has_audio": False,
        }
        names = ["height", "width", "channels"]
        image = {"dtype": "video", "shape": list(self._survey.shape), "names": names, "info": video}
        counters = {name: {"dtype": dtype, "shape": [1], "names": None} for name, dtype in COUNTERS.items()}
        features = {feature.name: feature.about for feature in self._survey.features}
        return {
            "codebase_version": VERSION,
            "robot_type": "haptigraph",
            "total_episodes": len(self._episodes),
            "total_frames": self._written,
            "total_tasks": 1,
            "chunks_size": CHUNK_FILES,
            "data_files_size_in_mb": DATA_MB,
            "video_files_size_in_mb": VIDEO_MB,
            "fps": self._survey.fps,
            "splits": {"train": f"0:{len(self._episodes)}"},
            "data_path": f"data/{PATTERN}.parquet",
            "video_path": f"videos/{{video_key}}/{PATTERN}.mp4",
            "features": {IMAGE: image, **features, **counters},
        }

    def _dictionary(self) -> Iterator[tuple[str, str, str, str]]:
        height, width, _ = self._survey.shape
        yield IMAGE, "video", "px", f"the image, {width} x {height}, that perception processed"
        for feature in self._survey.features:
            for name, unit, meaning in feature.channels:
                column = feature.name if len(feature.channels) == 1 else f"{feature.name}: {name}"
                yield column, feature.dtype, unit, meaning
        for name, (unit, meaning) in COUNTED.items():
            yield name, COUNTERS[name], unit, meaning


def _source(table: RunTable, *, is_simulated: bool) -> dict[str, Any]:
    info = table.reader.info
    losses = losses_sentence(table.reader.losses) if table.reader.losses else ""
    return {
        "recorded_with": info.version,
        "simulated": is_simulated,
        "rate_hz": info.rate_hz,
        "missing": losses,
        "procedure_sha256": info.procedure_sha256,
        "procedure": info.procedure,
    }


def _episode_row(episode: _Episode) -> dict[str, Any]:
    statistics = {
        f"stats/{feature}/{name}": value.tolist()
        for feature, (found, _) in episode.statistics.items()
        for name, value in found.items()
    }
    return episode.about | statistics


def _write_json(path: Path, content: Any) -> None:
    path.write_bytes(msgspec.json.format(msgspec.json.encode(content), indent=4) + b"\n")
