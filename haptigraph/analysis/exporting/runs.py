"""Export recorded runs in one of several formats, into a new folder with a data dictionary."""

import os
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import NamedTuple

from haptigraph.analysis.exporting.columns import RunTable
from haptigraph.analysis.exporting.csv_table import write_dictionary
from haptigraph.errors import BadInput, unknown_name
from haptigraph.folders import new_folder
from haptigraph.importing import load
from haptigraph.recording.writer import Progress

__all__ = ["FORMATS", "SUFFIXES", "export_run", "export_runs"]

EXPORTING = "haptigraph.analysis.exporting"
LEROBOT, DICTIONARY = "lerobot", "data_dictionary.csv"


class _Format(NamedTuple):
    """A format with a file for every recording."""

    writer: str
    """A function of recording, output and progress; of one with columns, also of the recording's name."""
    suffix: str
    parts: tuple[tuple[str, str, str, str], ...] | None = None
    """Name, kind, unit and meaning of what a file has; None: the columns of the table."""


ONE_FILE_EACH = {
    "csv": _Format(f"{EXPORTING}.csv_table:run_csv", ".csv"),
    "parquet": _Format(f"{EXPORTING}.parquet_table:run_parquet", ".parquet"),
    "mp4": _Format(
        "haptigraph.analysis.plots.run_video:run_video",
        ".mp4",
        (
            ("top", "text", "s", "surgical state, why, faults, time since the first step"),
            ("picture", "image", "px", "the image in the eye frame, with the detected geometry"),
            ("cone", "line", "deg", "directions that count as aligned"),
            ("strip", "line", "s", "amplitude commanded, 0 to 1, about now; background: states"),
        ),
    ),
    "foxglove": _Format(f"{EXPORTING}.foxglove_mcap:run_foxglove", ".mcap"),
}
FORMATS = (*ONE_FILE_EACH, LEROBOT)
SUFFIXES = {name: each.suffix for name, each in ONE_FILE_EACH.items()}
"""Of the formats that have a file for every recording."""


def export_runs(
    paths: Sequence[str | Path],
    kind: str,
    output: str | Path,
    progress: Progress | None = None,
    *,
    is_lossless: bool = False,
) -> str:
    """Write recordings into a new folder, whole or not at all.

    Args:
        paths: The recordings.
        kind: One of `FORMATS`.
        output: The folder to create.
        progress: Called with what is done, the number of steps written, and of all (0: unknown).
        is_lossless: Of LeRobot's videos: whether every pixel is kept.

    Returns:
        A sentence about what was written.

    Raises:
        BadInput: If a recording cannot be read, or the folder exists or cannot be written.
        MissingExtra: If a library of the format is not installed.
    """
    report = progress or (lambda what, done, total: None)
    names, output = _names(paths), Path(output)
    if output.suffix in SUFFIXES.values():
        problem = f"is to be a folder, with a file for each recording in it; leave out {output.suffix}"
        raise BadInput(problem, output)
    with new_folder(output) as folder:
        if kind == LEROBOT:
            write = load(f"{EXPORTING}.lerobot.dataset:write_lerobot")
            about: str = write([Path(path) for path in paths], folder, report, is_lossless=is_lossless)
            return about
        for path, name in zip(paths, names, strict=True):
            file = folder / f"{name}{ONE_FILE_EACH[kind].suffix}"
            file.parent.mkdir(parents=True, exist_ok=True)
            export_run(path, kind, file, report, name)
        parts = ONE_FILE_EACH[kind].parts
        write_dictionary(folder / DICTIONARY, _columns(paths) if parts is None else parts)
        if kind == "foxglove":
            layout = load(f"{EXPORTING}.foxglove_layout:write_foxglove_layout")
            layout(paths[0], folder / "layout.json", is_protobuf=True)
    return f"recordings: {len(paths)}; {DICTIONARY} has unit and meaning of every column or part"


def export_run(
    path: str | Path, kind: str, output: str | Path, progress: Progress | None = None, name: str | None = None
) -> None:
    """Write one recording as one file, in a format other than LeRobot's.

    Args:
        path: The recording.
        kind: The format.
        output: The file to write.
        progress: Called with what is done, the number of steps written, and of all (0: unknown).
        name: What the exported table calls the recording; None: the file's name.

    Raises:
        BadInput: If there is no such format, or the recording cannot be read.
        MissingExtra: If a library of the format is not installed.
    """
    if kind not in ONE_FILE_EACH:
        raise BadInput(unknown_name("format", kind, ONE_FILE_EACH))
    chosen = ONE_FILE_EACH[kind]
    write: Callable[..., object] = load(chosen.writer)
    named = (name or Path(path).stem,) if chosen.parts is None else ()
    write(path, output, progress, *named)


def _names(paths: Sequence[str | Path]) -> list[str]:
    """Return a name for every recording: its path below the folder that all share, without the suffix."""
    files = [Path(path).resolve() for path in paths]
    shared = Path(os.path.commonpath([file.parent for file in files]))
    names = [file.relative_to(shared).with_suffix("").as_posix() for file in files]
    for number, name in enumerate(names):
        if name in names[:number]:
            raise BadInput("is given twice, or has the name of another; export it separately", paths[number])
    return names


def _columns(paths: Sequence[str | Path]) -> Iterable[tuple[str, str, str, str]]:
    """Return name, kind, unit and meaning of the columns of all recordings, each once."""
    columns = (column for path in paths for column in RunTable(path, "").columns)
    return dict.fromkeys((column.name, column.kind, column.unit, column.meaning) for column in columns)
