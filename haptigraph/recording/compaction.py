"""Write complete recordings: zstd chunks, an index, and checksums of everything.

A video follows the steps, so that a file whose end is cut off keeps them.
"""

import itertools
import os
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import BinaryIO, TypeAlias

from mcap.records import Channel, McapRecord, Message, Metadata, Schema
from mcap.writer import CompressionType

from haptigraph.errors import BadInput
from haptigraph.recording.attachments import AttachedFile, AttachingWriter
from haptigraph.recording.header import is_header
from haptigraph.recording.journal import FileIdentity, complete_records, lock
from haptigraph.recording.unpacking import unpacked

__all__ = ["LIBRARY", "Progress", "compact", "write_compacted"]

LIBRARY = "haptigraph"
CHUNK_BYTES = 2**18  # before compression; so much may one damage cost
Progress: TypeAlias = Callable[[str, int, int], None]
"""Called with (activity, bytes done, total bytes)."""


def compact(
    path: Path,
    progress: Progress | None = None,
    identity: FileIdentity | None = None,
    *,
    unpacks_video: bool = False,
) -> int:
    """Rewrite a recording in place with chunks, zstd and an index; return the number of messages.

    An incomplete record at the end is left out. The file is replaced only after the new one is complete.

    Args:
        path: The recording.
        progress: Called with the progress.
        identity: That of the recording; None: whatever is there now.
        unpacks_video: Whether to replace its video by the images that were used, as PNG.

    Raises:
        BadInput: If the file is not a recording, or is damaged.
        FileChanged: If somebody else deleted, replaced or changed it.
        OSError: If it cannot be written.
    """
    report = progress or (lambda what, done, total: None)
    identity = identity or FileIdentity.of(path)
    identity.check(path)

    def records() -> Iterator[McapRecord]:
        for done, record in complete_records(path):
            yield record
            report("compacting the recording", done, identity.size)
        identity.check(path)

    try:
        return write_compacted(path, unpacked(records()) if unpacks_video else records())
    except KeyError:
        raise BadInput("damaged (a message of an unknown topic)", path) from None


def write_compacted(target: Path, records: Iterable[McapRecord]) -> int:
    """Write a complete recording by way of a new file beside it; return the number of messages.

    Args:
        target: The recording; replaced if it exists.
        records: Metadata, an attachment, schemas, channels and messages; repetitions of definitions are left
            out.

    Raises:
        OSError: If it cannot be written.
    """
    part = next(name for name in _part_names(target) if not name.exists())
    output = part.open("xb")
    lock(output.fileno(), "LOCK_EX")  # so that nobody takes it for a remnant
    try:
        with output:
            writer = AttachingWriter(output, CHUNK_BYTES, CompressionType.ZSTD, enable_data_crcs=True)
            writer.start(library=LIBRARY)
            messages = _copy(records, writer, output)
            writer.finish()  # type: ignore[no-untyped-call]
            output.flush()
            os.fsync(output.fileno())
        part.replace(target)
    except BaseException as error:
        part.unlink(missing_ok=True)
        if isinstance(error, OSError) and error.filename is None:
            error.filename = str(part)
        raise
    return messages


def _part_names(path: Path) -> Iterator[Path]:
    return (path.with_name(f"{path.name}.part{number or ''}") for number in itertools.count())


def _copy(records: Iterable[McapRecord], writer: AttachingWriter, output: BinaryIO) -> int:
    """Copy records under the new file's ids; return the number of messages."""
    schemas: dict[int, int] = {}
    channels: dict[int, int] = {}
    metadata: list[Metadata] = []
    attached: list[AttachedFile] = []
    messages = 0
    for record in records:
        if isinstance(record, Schema) and record.id not in schemas:
            schemas[record.id] = writer.register_schema(record.name, record.encoding, record.data)
        elif isinstance(record, Channel) and record.id not in channels:
            schema = schemas[record.schema_id]
            channels[record.id] = writer.register_channel(record.topic, record.message_encoding, schema)
        elif isinstance(record, Metadata) and record not in metadata:
            metadata.append(record)
            writer.add_metadata(record.name, record.metadata)
        elif isinstance(record, AttachedFile):
            attached.append(record)
        elif isinstance(record, Message):
            channel = channels[record.channel_id]
            writer.add_message(channel, record.log_time, record.data, record.publish_time, record.sequence)
            messages += 1
    for file in attached:
        writer.copy_attachment(output, file)
    for header in filter(is_header, metadata):  # again, far from the first, because nothing works without it
        writer.add_metadata(header.name, header.metadata)
    return messages
