"""A folder of recordings: a list of runs, from their headers alone, and single steps of opened runs.

Names are paths relative to the folder, at most one folder deep. Nothing outside the folder is ever opened.
"""

import threading
import tomllib
from collections import OrderedDict
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, NamedTuple

from mcap.reader import SeekingReader

from haptigraph.assemble import parse_procedure, procedure_names
from haptigraph.dashboard.server.protocol import image_header, pack
from haptigraph.errors import BadInput, HaptigraphError
from haptigraph.perception.eye_view import EyeView, VolumeView, view_of
from haptigraph.recording.codec import decode, encode_png
from haptigraph.recording.reader import RunReader, StepLocation
from haptigraph.recording.records import DAMAGE
from haptigraph.registration.loading import parse_registration

__all__ = ["Identity", "RecordingFolder"]

MAX_LISTED = 1000
MAX_OPEN = 8
VOLUME_PX = 720  # side of the picture of a volume


class Identity(NamedTuple):
    """Identity of a file's content: a recording with another size, date or inode is another one."""

    device: int
    number: int
    size: int
    changed_ns: int

    @classmethod
    def of(cls, path: Path) -> "Identity":
        """Return the identity of a file."""
        found = path.stat()
        return cls(found.st_dev, found.st_ino, found.st_size, found.st_mtime_ns)


class _OpenRun(NamedTuple):
    """A run whose steps can be read."""

    reader: RunReader
    identity: Identity
    places: list[StepLocation]
    moving: frozenset[str]
    view: EyeView
    start_ns: int


class RecordingFolder:
    """The page's access to a folder. Its methods block and are thread-safe.

    Args:
        folder: Folder of recordings.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder.resolve()
        self.outcomes: dict[Identity, dict[str, Any]] = {}
        """Measures of runs, as far as they have been computed."""
        self._headers: dict[Identity, dict[str, Any]] = {}
        self._open: OrderedDict[str, _OpenRun] = OrderedDict()
        self._lock = threading.Lock()

    def path_of(self, name: str) -> Path:
        """Return the path of a file in the folder.

        Raises:
            BadInput: If there is none of that name, or the path leads out of the folder.
        """
        try:
            path = (self.folder / name).resolve()
            is_inside = path.is_relative_to(self.folder) and "\0" not in name
        except (OSError, ValueError, RuntimeError):
            is_inside = False
        if not name or not is_inside:
            raise BadInput(f"{name!r} is not in the folder of recordings; choose one from the list")
        if not path.is_file():
            raise BadInput("does not exist (any more); refresh the list", name)
        return path

    def list_runs(self) -> dict[str, Any]:
        """Return the runs and procedures of the folder, newest runs first."""
        try:
            paths = [*self.folder.glob("*.mcap"), *self.folder.glob("*/*.mcap")]
            procedures = sorted(path.name for path in self.folder.glob("*.toml") if _is_procedure(path))
        except OSError as error:
            raise BadInput(f"cannot be read ({error.strerror})", self.folder) from None
        rows = [row for path in paths if (row := self._row(path))]
        rows.sort(key=lambda row: row["started_utc"] or row["changed_utc"], reverse=True)
        return {
            "folder": str(self.folder),
            "runs": rows[:MAX_LISTED],
            "left_out": max(len(rows) - MAX_LISTED, 0),
            "procedures": [*procedure_names(), *procedures],
        }

    def open_run(self, name: str, places: list[StepLocation]) -> None:
        """Make the steps of a run available to `step`.

        Args:
            name: The recording.
            places: Of its steps, in the file.

        Raises:
            BadInput: If it cannot be read.
        """
        path = self.path_of(name)
        identity, reader = Identity.of(path), RunReader(path)
        schema = parse_procedure(reader.info.procedure, f"procedure in {name}").schema
        registration = parse_registration(reader.info.registration, f"registration in {name}")
        moving = frozenset(entity.name for entity in schema.entities) - set(registration.anatomy)
        view = view_of(registration, VOLUME_PX)
        start_ns = reader.record_at(places[0])[1].stamp_ns
        with self._lock:
            self._open[name] = _OpenRun(reader, identity, places, moving, view, start_ns)
            self._open.move_to_end(name)
            while len(self._open) > MAX_OPEN:
                self._open.popitem(last=False)

    def step(self, name: str, number: int) -> bytes:
        """Return the image message of one step, with its image as recorded, else as PNG; volumes as drawn.

        Raises:
            BadInput: If there is no such step.
        """
        path = self.path_of(name)
        with self._lock:
            run = self._open.get(name)
        if run is None:
            raise BadInput("is not open any more; reload the page", name)
        now = Identity.of(path)
        # A run that is still being recorded only grows.
        if now[:2] != run.identity[:2] or now.size < run.places[-1].end:
            raise BadInput("has changed since it was opened; reload the page", name)
        if not 0 <= number < len(run.places):
            raise BadInput(f"has no step {number}; valid: 0 to {len(run.places) - 1}", name)
        capture, step = run.reader.record_at(run.places[number])
        picture = capture.encoded
        if picture is not None and isinstance(run.view, VolumeView):
            picture = encode_png(run.view(decode(picture), step.observation.found))
        elif picture is None and capture.image is not None:
            picture = encode_png(capture.image)
        time_ms = (step.stamp_ns - run.start_ns) / 1e6
        commanded_ns = step.timing.commanded_ns if step.timing else step.stamp_ns
        header = image_header(
            capture,
            step,
            run.moving,
            run.view,
            number=number,
            time_ms=time_ms,
            commanded_ms=(commanded_ns - run.start_ns) / 1e6,
            has_picture=picture is not None,
            hand=capture.hand,
        )
        return pack(header, picture or b"")

    def _row(self, path: Path) -> dict[str, Any] | None:
        """Return one row of the list; None if the file has gone or its path leads out of the folder."""
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
    """Return the columns that a run's header has, or the problem if it cannot be read."""
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
    """Return a run's length from the statistics at the end of its file; None if there are none."""
    with path.open("rb") as file:
        try:
            summary = SeekingReader(file).get_summary()
        except (*DAMAGE, OSError):
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
