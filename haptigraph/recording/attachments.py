"""Files attached to a recording: written, verified and copied block by block, because they may be large."""

import dataclasses
import struct
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import BinaryIO

from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import AttachmentIndex, McapRecord
from mcap.writer import Writer

from haptigraph.errors import BadInput

__all__ = [
    "CRC_BYTES",
    "AttachedFile",
    "AttachingWriter",
    "blocks",
    "parse_attachment",
    "write_attachment",
]

BLOCK = 2**20
RECORD_START = struct.Struct("<BQ")  # opcode, length
CRC_BYTES = 4


@dataclasses.dataclass
class AttachedFile(McapRecord):
    """An MCAP attachment without its content, and where that is."""

    path: Path
    """The recording."""
    start: int
    """Byte offset of the content in it."""
    size: int
    """Bytes of content."""
    name: str
    media_type: str
    created_ns: int
    attached_ns: int

    def at(self, path: Path, start: int) -> "AttachedFile":
        """Return the same attachment at another place."""
        return dataclasses.replace(self, path=path, start=start)

    def fields(self) -> bytes:
        """Return what is before the content."""
        builder = RecordBuilder()
        builder.write8(self.attached_ns)
        builder.write8(self.created_ns)
        builder.write_prefixed_string(self.name)
        builder.write_prefixed_string(self.media_type)
        builder.write8(self.size)
        fields: bytes = builder.end()  # type: ignore[no-untyped-call]
        return fields


class AttachingWriter(Writer):
    """The library's writer, which also copies an attachment without reading all of it into memory."""

    def copy_attachment(self, output: BinaryIO, file: AttachedFile) -> None:
        """Write an attachment of another recording, and verify it.

        Args:
            output: The file of this writer.
            file: The attachment.

        Raises:
            BadInput: If it has changed.
        """
        self._Writer__finalize_chunk()  # type: ignore[attr-defined] # what was added before comes before it
        self._Writer__flush()  # type: ignore[attr-defined] # the library takes an attachment's content as a whole
        offset = output.tell()

        def write(data: bytes) -> None:
            output.write(data)
            self._Writer__data_section_crc: int = zlib.crc32(data, self._Writer__data_section_crc)

        with file.path.open("rb") as source:
            source.seek(file.start)
            crc = write_attachment(file, source, write)
            if source.read(CRC_BYTES) != crc.to_bytes(CRC_BYTES, "little"):
                raise BadInput("damaged (crc of the attached file differs)", file.path)
        index = AttachmentIndex(
            offset=offset,
            length=output.tell() - offset,
            log_time=file.attached_ns,
            create_time=file.created_ns,
            data_size=file.size,
            name=file.name,
            media_type=file.media_type,
        )
        self._Writer__statistics.attachment_count += 1  # type: ignore[attr-defined]
        self._Writer__attachment_indexes.append(index)  # type: ignore[attr-defined]


def write_attachment(file: AttachedFile, source: BinaryIO, write: Callable[[bytes], object]) -> int:
    """Write an attachment as an MCAP record; return its CRC.

    Args:
        file: What to write; its path and start are not used.
        source: Its content, from the current position.
        write: Called with every block.

    Raises:
        BadInput: If there is less content.
    """
    fields = file.fields()
    write(RECORD_START.pack(Opcode.ATTACHMENT, len(fields) + file.size + CRC_BYTES) + fields)
    crc, left = zlib.crc32(fields), file.size
    while left:
        block = source.read(min(BLOCK, left))
        if not block:
            raise BadInput(f"became shorter while it was read, by {left} bytes", file.path)
        write(block)
        crc, left = zlib.crc32(block, crc), left - len(block)
    write(crc.to_bytes(CRC_BYTES, "little"))
    return crc


def parse_attachment(source: BinaryIO, path: Path, at: int, length: int) -> AttachedFile:
    """Return the attachment in an MCAP record; its content is not read.

    Args:
        source: The recording.
        path: Its path.
        at: Byte offset of the record's content.
        length: Its length.

    Raises:
        ValueError: If the lengths in it differ.
    """
    source.seek(at)
    stamps = source.read(16)
    texts = list[bytes]()
    for _ in range(2):
        text_length = int.from_bytes(source.read(4), "little")
        if text_length > BLOCK:
            raise ValueError("lengths of an attachment differ")
        texts.append(source.read(text_length))
    size = int.from_bytes(source.read(8), "little")
    start = source.tell()
    if start + size + CRC_BYTES != at + length:
        raise ValueError("lengths of an attachment differ")
    attached_ns, created_ns = struct.unpack("<QQ", stamps)
    name, media_type = (text.decode() for text in texts)
    return AttachedFile(path, start, size, name, media_type, created_ns, attached_ns)


def blocks(source: BinaryIO, at: int, length: int) -> Iterator[bytes]:
    """Yield bytes of a file in blocks."""
    source.seek(at)
    while length and (block := source.read(min(BLOCK, length))):
        yield block
        length -= len(block)
