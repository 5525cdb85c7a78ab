"""Bring the index of an archive up to date: only recordings that are new or have changed are read."""

from pathlib import Path
from typing import Any, NamedTuple

from msgspec import Struct

from haptigraph.analysis.archive.entry import Entry, IndexTask, index_recording
from haptigraph.analysis.archive.recordings import check_folder, found_recordings
from haptigraph.analysis.archive.tables import Archive, no_runs, steps_table, with_rows
from haptigraph.recording.journal import not_being_written
from haptigraph.recording.writer import Progress
from haptigraph.spreading.spread import spread
from haptigraph.spreading.tasks import Cluster, Killed

__all__ = ["Changes", "Updated", "changes_in", "update_archive"]

PART_STEPS = 200_000
PART_RECORDINGS = 500
"""Most recordings that are read again if an update is killed."""


class Updated(Struct):
    """What an update did."""

    indexed: int = 0
    """Recordings that were read."""
    unchanged: int = 0
    removed: int = 0
    """Recordings that are gone; their steps are erased from the archive."""
    being_written: int = 0
    """Recordings that are not indexed yet."""
    damaged: list[tuple[str, str]] = []
    """Recordings read now, or earlier, that cannot be read, and why."""
    is_made_again: bool = False
    """Whether there was an index of another version, so that all recordings were read."""


class Changes(NamedTuple):
    """How a folder differs from its index."""

    to_read: list[IndexTask]
    gone: list[str]
    """Rows whose recording has changed or is gone."""


def changes_in(recordings: Path, runs: Any) -> Changes:
    """Compare a folder with its index, by the size and time of change of each file.

    Args:
        recordings: The folder.
        runs: The table of its index; None: there is none.
    """
    rows = [] if runs is None else runs.select(["recording", "bytes", "changed_ns"]).to_pylist()
    known = {row["recording"]: (row["bytes"], row["changed_ns"]) for row in rows}
    to_read, same, folder = list[IndexTask](), set[str](), str(recordings.resolve())
    for found in found_recordings(recordings):
        if known.get(found.name) == (found.size, found.changed_ns):
            same.add(found.name)
        else:
            to_read.append(IndexTask(folder, *found))
    return Changes(to_read, [name for name in known if name not in same])


def update_archive(
    folder: Path,
    *,
    workers: int = 1,
    cluster: Cluster | None = None,
    progress: Progress | None = None,
) -> Updated:
    """Index what is new or has changed, and erase what is gone.

    Args:
        folder: The folder of recordings.
        workers: Number of processes on this machine.
        cluster: A Dask cluster to use instead; its workers must see the folder under the same path.
        progress: Called with the number of recordings read.

    Raises:
        BadInput: If the folder or its index cannot be used, or it is being updated by another program.
    """
    check_folder(folder)
    archive = Archive(folder)
    archive.place.mkdir(exist_ok=True)
    lock = archive.place / "lock"
    lock.touch()
    with not_being_written(lock, "is being updated by another program; wait for it, or end it"):
        before = archive.runs()
        is_made_again = before is None and archive.exists
        changes = changes_in(folder, before)
        runs = no_runs() if before is None else archive.without(before, changes.gone)
        archive.write_runs(runs)
        again = {task.name for task in changes.to_read}
        removed = sum(name not in again for name in changes.gone)
        updated = Updated(unchanged=len(runs), removed=removed, is_made_again=is_made_again)
        part = _Part(archive, runs)
        if progress is not None:
            progress("indexing", 0, len(changes.to_read))
        entries = spread(index_recording, changes.to_read, workers=workers, cluster=cluster)
        for done, (task, entry) in enumerate(entries if changes.to_read else (), 1):
            if isinstance(entry, Entry) and entry.is_being_written:
                updated.being_written += 1
            else:
                updated.indexed += 1
                part.add(entry if isinstance(entry, Entry) else _unreadable(task, entry))
            if progress is not None:
                progress("indexing", done, len(changes.to_read))
        part.write()
        rows = part.runs.select(["recording", "problem"]).to_pylist()
    updated.damaged = sorted((row["recording"], row["problem"]) for row in rows if row["problem"])
    return updated


class _Part:
    """Entries that are not in the archive yet."""

    def __init__(self, archive: Archive, runs: Any) -> None:
        self._archive = archive
        self.runs = runs
        self._rows, self._steps = list[dict[str, Any]](), list[Any]()

    def add(self, entry: Entry) -> None:
        """Add an entry, and write all if they are many."""
        self._rows.append(entry.row)
        if entry.steps:
            self._steps.append(steps_table(entry.row["recording"], entry.steps))
        steps = sum(len(table) for table in self._steps)
        if steps >= PART_STEPS or len(self._rows) >= PART_RECORDINGS:
            self.write()

    def write(self) -> None:
        """Write what was added since the last call."""
        if not self._rows:
            return
        name = self._archive.write_part(self._steps) if self._steps else None
        rows = [row if "problem" in row else row | {"part": name} for row in self._rows]
        self.runs = with_rows(self.runs, rows)
        self._archive.write_runs(self.runs)
        self._rows, self._steps = [], []


def _unreadable(task: IndexTask, killed: Killed) -> Entry:
    row = {"recording": task.name, "bytes": task.size, "changed_ns": task.changed_ns}
    return Entry(row | {"problem": killed.problem})
