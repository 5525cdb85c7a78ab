"""A folder of recordings: what is in it, told from headers alone; and single steps of those that were read.

Names are paths relative to the folder, at most one folder deep. Nothing outside the folder is ever opened.
"""

import threading
import tomllib
from collections import OrderedDict
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, NamedTuple

from mcap.exceptions import McapError
from mcap.reader import SeekingReader

from haptigraph.assemble import parse_procedure, procedure_names
from haptigraph.dashboard.server.protocol import packed, shown
from haptigraph.errors import BadInput, HaptigraphError
from haptigraph.recording.reader import Place, RunReader
from haptigraph.registration.loading import parse_registration

__all__ = ["Identity", "RecordingFolder"]

MOST_LISTED = 1000
MOST_OPEN = 8


class Identity(NamedTuple):
    """A file as it was; another size, date or place on the disk: another recording."""

    device: int
    number: int
    size: int
    changed_ns: int

    @classmethod
    def of(cls, path: Path) -> "Identity":
        """Return the identity of a file."""
        found = path.stat()
        return cls(found.st_dev, found.st_ino, found.st_size, found.st_mtime_ns)


class _Open(NamedTuple):
    """A run whose steps can be asked for."""

    reader: RunReader
    identity: Identity
    places: list[Place]
    moving: frozenset[str]
    start_ns: int


class RecordingFolder:
    """Everything the page may know of a folder. Its methods block, so call them from a thread; any thread.

    Args:
        folder: Where the recordings are.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder.resolve()
        self.outcomes: dict[Identity, dict[str, Any]] = {}
        """Measures of runs, once known."""
        self._headers: dict[Identity, dict[str, Any]] = {}
        self._open: OrderedDict[str, _Open] = OrderedDict()
        self._lock = threading.Lock()

    def path_of(self, name: str) -> Path:
        """Return the path of a file in the folder.

        Raises:
            BadInput: If there is none of that name, or the name leads elsewhere.
        """
        try:
            path = (self.folder / name).resolve()
            inside = path.is_relative_to(self.folder) and "\0" not in name
        except (OSError, ValueError, RuntimeError):
            inside = False
        if not name or not inside:
            raise BadInput(f"{name!r} is not in the folder of recordings; only what is in it is shown")
        if not path.is_file():
            raise BadInput("is not there (any more); load the list again", name)
        return path

    def listed(self) -> dict[str, Any]:
        """Return what is in the folder, newest first."""
        try:
            paths = [*self.folder.glob("*.mcap"), *self.folder.glob("*/*.mcap")]
            procedures = sorted(path.name for path in self.folder.glob("*.toml") if _is_procedure(path))
        except OSError as error:
            raise BadInput(f"cannot be read ({error.strerror})", self.folder) from None
        rows = [row for path in paths if (row := self._row(path))]
        rows.sort(key=lambda row: row["started_utc"] or row["changed_utc"], reverse=True)
        return {
            "folder": str(self.folder),
            "runs": rows[:MOST_LISTED],
            "left_out": max(len(rows) - MOST_LISTED, 0),
            "procedures": [*procedure_names(), *procedures],
        }

    def keep(self, name: str, places: list[Place]) -> None:
        """Make the steps of a run available.

        Args:
            name: The recording.
            places: Where its steps are.

        Raises:
            BadInput: If it cannot be read.
        """
        path = self.path_of(name)
        identity, reader = Identity.of(path), RunReader(path)
        schema = parse_procedure(reader.info.procedure, f"procedure in {name}").schema
        anatomy = parse_registration(reader.info.registration, f"registration in {name}").anatomy
        moving = frozenset(entity.name for entity in schema.entities) - set(anatomy)
        start_ns = reader.record_at(places[0])[1].stamp_ns
        with self._lock:
            self._open[name] = _Open(reader, identity, places, moving, start_ns)
            self._open.move_to_end(name)
            while len(self._open) > MOST_OPEN:
                self._open.popitem(last=False)

    def step(self, name: str, number: int) -> bytes:
        """Return one step as the page is told it: header and image, which is sent as it was recorded.

        Raises:
            BadInput: If there is no such step.
        """
        path = self.path_of(name)
        with self._lock:
            run = self._open.get(name)
        if run is None:
            raise BadInput("is not open any more; load the page again", name)
        now = Identity.of(path)
        # A run that is still recorded only grows.
        if now[:2] != run.identity[:2] or now.size < run.places[-1].end:
            raise BadInput("has changed meanwhile; load the page again", name)
        if not 0 <= number < len(run.places):
            raise BadInput(f"has no step {number}; they go from 0 to {len(run.places) - 1}", name)
        capture, step = run.reader.record_at(run.places[number])
        time_ms = (step.stamp_ns - run.start_ns) / 1e6
        commanded_ns = step.timing.commanded_ns if step.timing else step.stamp_ns
        header = shown(
            step,
            run.moving,
            number=number,
            time_ms=time_ms,
            commanded_ms=(commanded_ns - run.start_ns) / 1e6,
            has_picture=capture.encoded is not None,
            hand=capture.hand,
        )
        return packed(header, capture.encoded or b"")

    def _row(self, path: Path) -> dict[str, Any] | None:
        """Return one line of the list; None if the file went away meanwhile or leads elsewhere."""
        name = path.relative_to(self.folder).as_posix()
        try:
            self.path_of(name)
            identity = Identity.of(path)
            if identity not in self._headers:
                self._headers[identity] = _header(path)
        except (HaptigraphError, OSError):
            return None
        return {
            "name": name,
            "size": identity.size,
            "changed_utc": _utc(identity.changed_ns),
            **self._headers[identity],
            "outcome": self.outcomes.get(identity),
        }


def _header(path: Path) -> dict[str, Any]:
    """Tell a run from its header, or say why that cannot be."""
    row: dict[str, Any] = {"started_utc": "", "problem": "", "note": "", "length_s": None}
    try:
        reader = RunReader(path)
        row["length_s"] = _length_s(path) if reader.is_whole else None
    except (HaptigraphError, OSError) as error:
        problem = error.problem if isinstance(error, BadInput) else str(error)
        return {**row, "problem": problem}
    info = reader.info
    for name in ("started_utc", "source", "participant", "trial", "version"):
        row[name] = getattr(info, name)
    row["procedure"] = _title(info.procedure)
    row["is_whole"], row["is_being_written"] = reader.is_whole, reader.is_being_written
    return row


def _length_s(path: Path) -> float | None:
    """Return how long a run is from the statistics at the file's end; None if they are not there."""
    with path.open("rb") as file:
        try:
            summary = SeekingReader(file).get_summary()
        except (McapError, ValueError, OSError):
            return None
    if summary is None or summary.statistics is None:
        return None
    return (summary.statistics.message_end_time - summary.statistics.message_start_time) / 1e9


def _title(procedure: str) -> str:
    try:
        return str(tomllib.loads(procedure)["procedure"]["name"])
    except (tomllib.TOMLDecodeError, KeyError, TypeError, RecursionError):
        return ""


def _is_procedure(path: Path) -> bool:
    try:
        return "[[state]]" in path.read_text(encoding="utf-8")[:200_000]
    except (OSError, UnicodeDecodeError):
        return False


def _utc(stamp_ns: int) -> str:
    return datetime.fromtimestamp(stamp_ns / 1e9, UTC).isoformat()
