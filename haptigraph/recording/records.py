"""Turn the bytes of one MCAP record into the record, and those of a chunk into its records, verified."""

import struct
import zlib
from collections.abc import Callable
from io import BytesIO

import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import EndOfFile, McapError
from mcap.opcode import Opcode
from mcap.records import (
    Attachment,
    AttachmentIndex,
    Channel,
    Chunk,
    ChunkIndex,
    DataEnd,
    Footer,
    Header,
    McapRecord,
    Message,
    MessageIndex,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)
from mcap.stream_reader import breakup_chunk, get_chunk_data_stream

__all__ = ["DAMAGE", "RECORD_TYPES", "parse_record"]

DAMAGE = (McapError, zstandard.ZstdError, struct.error, ValueError, OverflowError, MemoryError)
"""What reading a damaged record raises."""
RECORD_TYPES: dict[int, Callable[[ReadDataStream, int], McapRecord]] = {
    Opcode.HEADER: lambda stream, length: Header.read(stream),
    Opcode.FOOTER: lambda stream, length: Footer.read(stream),
    Opcode.SCHEMA: lambda stream, length: Schema.read(stream),
    Opcode.CHANNEL: lambda stream, length: Channel.read(stream),
    Opcode.MESSAGE: Message.read,
    Opcode.CHUNK: lambda stream, length: Chunk.read(stream),
    Opcode.MESSAGE_INDEX: lambda stream, length: MessageIndex.read(stream),
    Opcode.CHUNK_INDEX: lambda stream, length: ChunkIndex.read(stream),
    Opcode.ATTACHMENT: lambda stream, length: Attachment.read(stream),
    Opcode.ATTACHMENT_INDEX: lambda stream, length: AttachmentIndex.read(stream),
    Opcode.STATISTICS: lambda stream, length: Statistics.read(stream),
    Opcode.METADATA: lambda stream, length: Metadata.read(stream),
    Opcode.METADATA_INDEX: lambda stream, length: MetadataIndex.read(stream),
    Opcode.SUMMARY_OFFSET: lambda stream, length: SummaryOffset.read(stream),
    Opcode.DATA_END: lambda stream, length: DataEnd.read(stream),
}


class _ExactStream(ReadDataStream):
    """Bytes of one record, of which none may be missing."""

    def read(self, length: int) -> bytes:
        data = super().read(length)
        if len(data) != length:
            raise EndOfFile
        return data


def parse_record(opcode: int, body: bytes) -> tuple[McapRecord, ...]:
    """Return a record, or the records of a chunk after a check of its CRC, which must not be absent.

    Args:
        opcode: Its type, one of `RECORD_TYPES`.
        body: Its content.

    Raises:
        One of `DAMAGE`: If it cannot be verified.
    """
    stream = _ExactStream(BytesIO(body))
    record = RECORD_TYPES[opcode](stream, len(body))
    if stream.count != len(body):
        raise ValueError("lengths differ")
    return _records_in(record) if isinstance(record, Chunk) else (record,)


def _records_in(chunk: Chunk) -> tuple[McapRecord, ...]:
    sizes = (zstandard.CONTENTSIZE_UNKNOWN, chunk.uncompressed_size)
    if chunk.compression == "zstd" and zstandard.get_frame_parameters(chunk.data).content_size not in sizes:
        raise ValueError("sizes of a chunk differ")  # before as much memory is taken
    stream, length = get_chunk_data_stream(chunk)
    data = stream.read(length)
    if len(data) != chunk.uncompressed_size or zlib.crc32(data) != chunk.uncompressed_crc:
        raise ValueError("crc of a chunk differs")
    chunk.data, chunk.compression = data, ""
    records = tuple(breakup_chunk(chunk))
    stamps = [record.log_time for record in records if isinstance(record, Message)]
    if stamps and (min(stamps), max(stamps)) != (chunk.message_start_time, chunk.message_end_time):
        raise ValueError("times of a chunk differ")
    return records
