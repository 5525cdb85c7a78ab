"""Write runs to MCAP so that a killed process loses nothing, and compact them at the end.

A run is written as an unchunked journal, each record straight to the file descriptor. On a clean close it is
rewritten with zstd chunks and an index. `sinks.recorder` runs this in its own thread.
"""

import itertools
import os
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import IO, Any, BinaryIO, TypeAlias, cast

import msgspec
from mcap.records import Channel, McapRecord, Message, Metadata, Schema
from mcap.writer import CompressionType, Writer

from haptigraph.errors import BadInput
from haptigraph.geometry import ImageGeometry
from haptigraph.messages import Capture, Step
from haptigraph.recording.entries import entries
from haptigraph.recording.journal import Journal, complete_records, is_whole, not_being_written
from haptigraph.recording.schema import TOPICS, RunInfo, mcap_schema

__all__ = ["METADATA", "Progress", "RunWriter", "compact", "recover"]

METADATA = "haptigraph"
NEW_FILE = os.O_WRONLY | os.O_CREAT | os.O_EXCL | getattr(os, "O_BINARY", 0)
Progress: TypeAlias = Callable[[str, int, int], None]
"""Called with (activity, bytes done, total bytes)."""


class RunWriter:
    """Append steps to a new recording.

    Args:
        path: The MCAP file; it must not exist.
        info: The header.
        image: Transformation between images and eye frame, for the annotations.
        measures: Names of the measures in the graphs.

    Raises:
        BadInput: If the file exists or cannot be created.
    """

    def __init__(
        self, path: str | Path, info: RunInfo, image: ImageGeometry, measures: tuple[str, ...]
    ) -> None:
        self.path = Path(path)
        self._info, self._image = info, image
        try:
            self._file = Journal(os.open(self.path, NEW_FILE, 0o644))
        except FileExistsError:
            raise BadInput("exists already; a recording never overwrites a file", path) from None
        except OSError as error:
            raise BadInput(f"cannot be written ({error.strerror})", path) from None
        self.is_complete = False
        """Whether the file contains the complete run, compacted or not."""
        self._sequence = 0
        try:
            self._writer = Writer(cast(IO[bytes], self._file), use_chunking=False)
            self._channels = self._begin(measures)
        except BaseException as error:
            self.discard()
            if isinstance(error, OSError):
                raise BadInput(f"cannot be written ({error.strerror})", path) from None
            raise

    def write(self, capture: Capture, step: Step, *, dropped: bool = False) -> None:
        """Append one step.

        Args:
            capture: The capture of the step.
            step: The step.
            dropped: True if there was an image that is not recorded.

        Raises:
            OSError: If it cannot be written.
        """
        utc_offset_ns = self._info.utc_offset_ns
        for topic, message in entries(
            capture, step, image=self._image, utc_offset_ns=utc_offset_ns, dropped=dropped
        ):
            self._add(topic, step.stamp_ns, message)
        self._sequence += 1

    def close(self, progress: Progress | None = None) -> None:
        """Finish and compact the file, or remove it if it has no steps. May be called twice."""
        if self._file.closed:
            return
        if not self._sequence:
            self.discard()
            return
        self._writer.finish()  # type: ignore[no-untyped-call]
        self._file.close()
        self.is_complete = True
        compact(self.path, progress)

    def abandon(self) -> None:
        """Close the file as it is, for instance after a disk error; `recover` can repair it."""
        with suppress(OSError):  # the caller has reported the error
            self._file.close()

    def discard(self) -> None:
        """Close and remove the file of a run that never began; do nothing once it is closed."""
        if not self._file.closed:
            self.abandon()
            self.path.unlink(missing_ok=True)

    def _begin(self, measures: tuple[str, ...]) -> dict[str, int]:
        """Write header, schemas and channels; return the channel ids by topic."""
        self._writer.start(profile="", library=f"haptigraph {self._info.version}")
        header = {key: str(value) for key, value in msgspec.to_builtins(self._info).items()}
        self._writer.add_metadata(METADATA, header)
        channels = {}
        for topic in TOPICS:
            schema = msgspec.json.encode(mcap_schema(topic, measures))
            schema_id = self._writer.register_schema(topic.schema, "jsonschema", schema)
            channels[topic.name] = self._writer.register_channel(topic.name, "json", schema_id)
        return channels

    def _add(self, topic: str, stamp_ns: int, message: Any) -> None:
        utc_ns = stamp_ns + self._info.utc_offset_ns
        self._writer.add_message(
            channel_id=self._channels[topic],
            log_time=utc_ns,
            publish_time=utc_ns,
            sequence=self._sequence,
            data=msgspec.json.encode(message),
        )


def recover(path: Path, progress: Progress | None = None) -> bool:
    """Repair an interrupted recording in place; return False if it was complete already.

    Raises:
        BadInput: If the file is not a recording, or is still being written.
        OSError: If it cannot be written.
    """
    with not_being_written(path):
        if is_whole(path):
            return False
        compact(path, progress)
        return True


def compact(path: Path, progress: Progress | None = None) -> int:
    """Rewrite a recording in place with chunks, zstd and an index; return the number of messages.

    An incomplete record at the end is left out. The file is replaced only after the new one is complete.

    Raises:
        BadInput: If the file is not a recording.
        OSError: If it cannot be written.
    """
    part = _new_name_beside(path)
    output = part.open("xb")
    try:
        with output:
            messages = _compact_to(output, path, progress or (lambda what, done, total: None))
        part.replace(path)
    except BaseException as error:
        part.unlink(missing_ok=True)
        if isinstance(error, OSError) and error.filename is None:
            error.filename = str(part)
        raise
    return messages


def _new_name_beside(path: Path) -> Path:
    names = (f"{path.name}.part{number or ''}" for number in itertools.count())
    return next(new for new in map(path.with_name, names) if not new.exists())


def _compact_to(output: BinaryIO, path: Path, progress: Progress) -> int:
    writer = Writer(output, compression=CompressionType.ZSTD)
    writer.start(library="haptigraph")
    messages, size = 0, path.stat().st_size
    ids: dict[tuple[str, int], int] = {}
    for done, record in complete_records(path):
        try:
            messages += _copy(record, writer, ids)
        except KeyError:
            raise BadInput("damaged (a message of an unknown topic)", path, f"byte {done}") from None
        progress("compacting the recording", done, size)
    writer.finish()  # type: ignore[no-untyped-call]
    output.flush()
    os.fsync(output.fileno())
    return messages


def _copy(record: McapRecord, writer: Writer, ids: dict[tuple[str, int], int]) -> int:
    """Copy one record under the new file's ids; return the number of messages (0 or 1)."""
    if isinstance(record, Schema) and ("schema", record.id) not in ids:
        ids["schema", record.id] = writer.register_schema(record.name, record.encoding, record.data)
    elif isinstance(record, Channel) and ("channel", record.id) not in ids:
        schema_id = ids["schema", record.schema_id]
        ids["channel", record.id] = writer.register_channel(record.topic, record.message_encoding, schema_id)
    elif isinstance(record, Metadata):
        writer.add_metadata(record.name, record.metadata)
    elif isinstance(record, Message):
        writer.add_message(
            ids["channel", record.channel_id],
            record.log_time,
            record.data,
            record.publish_time,
            record.sequence,
        )
        return 1
    return 0
