"""Read MCAP files piece by piece, check every checksum, and go on behind damage."""

import os
import re
import struct
import zlib
from collections.abc import Iterator
from pathlib import Path
from stat import S_ISREG
from typing import BinaryIO, Literal, NamedTuple, TypeAlias

import msgspec
from mcap.opcode import Opcode
from mcap.records import DataEnd, McapRecord, Message, Metadata, Statistics

from haptigraph.errors import BadInput
from haptigraph.recording.attachments import CRC_BYTES, blocks, parse_attachment
from haptigraph.recording.records import DAMAGE, RECORD_TYPES, parse_record
from haptigraph.recording.schema import UNCHECKED

__all__ = ["FOOTER", "MAGIC", "Damage", "Piece", "open_regular", "scan", "scan_between"]

MAGIC = b"\x89MCAP0\r\n"
RECORD_HEADER = struct.Struct("<BQ")  # opcode, length
CHUNK_START = struct.Struct("<QQQII")  # first and last log time, size, CRC, length of the compression's name
FOOTER = struct.Struct("<BQQQI")  # opcode, length, start of the summary and of its offsets, CRC
MESSAGE_START = 22  # bytes before a message's content
MAX_RECORD = 2**30
MAX_NAME = 4  # longest name of a compression
BLOCK = 2**20
IN_CHUNKS = (Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE)
CANDIDATE = re.compile(rb"[\x03\x04\x05\x06\x09\x0c\x0f](?=[\s\S]{5}\0\0\0)")
"""Start of a schema, channel, message, chunk, attachment, metadata or end of data, below 2^40 bytes."""


class Piece(NamedTuple):
    """One record of the file; a chunk counts as the records in it."""

    start: int
    """Byte offset."""
    end: int
    records: tuple[McapRecord, ...]
    is_data: bool = True
    """False in the summary at the end, which repeats what the data say."""
    has_crc: bool = False
    """Whether it is a chunk, whose CRC was checked."""


Kind: TypeAlias = Literal["lost", "cut", "torn", "summary"]


class Damage(NamedTuple):
    """Bytes that cannot be read."""

    start: int
    """Byte offset."""
    end: int
    problem: str
    kind: Kind
    """Torn: an incomplete record at the end, as a killed process leaves it. Cut: the end of a complete
    recording is missing. Summary: the data are not affected."""


class _Problem(Exception):
    def __init__(self, problem: str, *, is_torn: bool = False) -> None:
        super().__init__(problem)
        self.is_torn = is_torn


def open_regular(path: Path) -> BinaryIO:
    """Open a file for reading.

    Raises:
        BadInput: If it cannot be read, or is a folder, a pipe or a device.
    """
    try:
        if not S_ISREG(path.stat().st_mode):  # opening a pipe would wait for its writer
            raise BadInput("cannot be read (not a regular file)", path)
        return path.open("rb")
    except OSError as error:
        raise BadInput(f"cannot be read ({error.strerror})", path) from None


def scan(path: Path, *, verifies_attachments: bool = True) -> Iterator[Piece | Damage]:
    """Yield everything in an MCAP file, in order.

    Behind damage, go on at the next record that can be verified. An interrupted file ends after its last
    record, or with torn bytes.

    Args:
        path: The file.
        verifies_attachments: Whether attachments, which may be large, are read, and not only found.

    Raises:
        BadInput: If the file cannot be read.
    """
    with open_regular(path) as file:
        yield from _Scanner(file, path, verifies_attachments=verifies_attachments).pieces()


def scan_between(path: Path, start: int, end: int, *, verifies_attachments: bool = True) -> Iterator[Piece]:
    """Yield the records between two byte offsets at record boundaries, like `scan`.

    Raises:
        BadInput: If they cannot be read.
    """
    with open_regular(path) as file:
        scanner = _Scanner(file, path, verifies_attachments=verifies_attachments)
        scanner.size = min(scanner.size, end)
        while start < scanner.size:
            try:
                piece = scanner.read_piece(start)
            except _Problem as problem:
                raise BadInput(f"damaged ({problem})", path, f"byte {start}") from None
            yield piece
            start = piece.end


class _Scanner:
    def __init__(self, file: BinaryIO, path: Path, *, verifies_attachments: bool = True) -> None:
        self._file, self._path, self._verifies_attachments = file, path, verifies_attachments
        self.size = os.fstat(file.fileno()).st_size
        self._data_crc = 0
        self._messages = 0
        self._is_data, self._is_compressed, self._is_damaged = True, False, False
        self._has_chunks = False
        self._is_closed = self._read(max(self.size - len(MAGIC), 0), len(MAGIC)) == MAGIC

    def pieces(self) -> Iterator[Piece | Damage]:
        at = len(MAGIC)
        if self._read(0, at) != MAGIC:
            at = 0
        self._data_crc = zlib.crc32(MAGIC)
        while at < self.size:
            try:
                piece = self.read_piece(at)
            except _Problem as problem:
                piece_or_damage: Piece | Damage = self._damage(at, problem)
                self._is_damaged = True
            else:
                piece_or_damage = piece
                if piece.records and isinstance(piece.records[0], DataEnd):
                    yield from self._end(piece, piece.records[0])
                    return
            yield piece_or_damage
            at = piece_or_damage.end
        if self._is_compressed and not self._is_damaged:  # an interrupted run leaves no compressed chunks
            yield Damage(self.size, self.size, "the end of the file is missing", "cut")

    def read_piece(self, at: int) -> Piece:
        """Read and verify one record.

        Raises:
            _Problem: If it cannot be verified.
        """
        start = self._read(at, RECORD_HEADER.size)
        opcode, length = self._check_start(at, start)
        end = at + RECORD_HEADER.size + length
        if opcode == Opcode.ATTACHMENT:
            return self._read_attachment(at, end, start)
        body = self._read(at + RECORD_HEADER.size, length)
        try:
            records = parse_record(opcode, body)
        except DAMAGE as error:
            raise _Problem(str(error) or "lengths differ") from None
        if opcode == Opcode.MESSAGE and b"\0" in body[MESSAGE_START:]:  # JSON has none; lengths of records do
            raise _Problem("lengths differ")
        if opcode != Opcode.DATA_END:
            self._data_crc = zlib.crc32(body, zlib.crc32(start, self._data_crc))
        self._has_chunks |= opcode == Opcode.CHUNK or any(map(_announces_chunks, records))
        self._messages += sum(isinstance(record, Message) for record in records)
        return Piece(at, end, records, self._is_data, opcode == Opcode.CHUNK)

    def _read_attachment(self, at: int, end: int, start: bytes) -> Piece:
        """Verify an attachment without keeping it in memory."""
        content_at, crc_at = at + RECORD_HEADER.size, end - CRC_BYTES
        try:
            attached = parse_attachment(self._file, self._path, content_at, end - content_at)
        except DAMAGE as error:
            raise _Problem(str(error) or "lengths differ") from None
        if self._verifies_attachments:
            crc, data_crc = 0, zlib.crc32(start, self._data_crc)
            for block in blocks(self._file, content_at, crc_at - content_at):
                crc, data_crc = zlib.crc32(block, crc), zlib.crc32(block, data_crc)
            stored = self._read(crc_at, CRC_BYTES)
            if stored != crc.to_bytes(CRC_BYTES, "little"):
                raise _Problem(f"crc of the attached {attached.name} differs")
            self._data_crc = zlib.crc32(stored, data_crc)
        return Piece(at, end, (attached,), self._is_data)

    def _check_start(self, at: int, start: bytes) -> tuple[int, int]:
        """Return type and length of a record, if they are possible here."""
        if len(start) < RECORD_HEADER.size:
            raise _Problem("an incomplete record", is_torn=True)
        opcode, length = RECORD_HEADER.unpack(start)
        if opcode not in RECORD_TYPES:
            raise _Problem(f"record of unknown type {opcode}")
        if opcode in IN_CHUNKS and self._has_chunks and self._is_data:
            raise _Problem("a record outside of its chunk")
        if length > MAX_RECORD and opcode != Opcode.ATTACHMENT:
            raise _Problem(f"record of {length} bytes")
        if opcode == Opcode.CHUNK:
            self._check_chunk_lengths(at + RECORD_HEADER.size, length)
        if at + RECORD_HEADER.size + length > self.size:
            what = "attached video" if opcode == Opcode.ATTACHMENT else "record"
            raise _Problem(f"an incomplete {what}", is_torn=True)
        return opcode, length

    def _check_chunk_lengths(self, at: int, length: int) -> None:
        """Check a chunk's lengths against each other, as far as they are in the file."""
        start = self._read(at, CHUNK_START.size)
        if len(start) < CHUNK_START.size:
            return
        *_, size, _, name_length = CHUNK_START.unpack(start)
        data_at = CHUNK_START.size + name_length + 8
        is_consistent = name_length <= MAX_NAME and size <= MAX_RECORD
        if not is_consistent or (not name_length and size != length - data_at):
            raise _Problem("the lengths of a chunk differ")
        data_length = self._read(at + data_at - 8, 8)
        if len(data_length) == 8 and int.from_bytes(data_length, "little") != length - data_at:
            raise _Problem("the lengths of a chunk differ")
        if name_length:
            self._is_compressed = True

    def _end(self, end: Piece, record: DataEnd) -> Iterator[Piece | Damage]:
        """Yield the summary behind the end of the data, if its checksum verifies."""
        yield end
        if record.data_section_crc not in (0, self._data_crc) and not self._is_damaged:
            yield Damage(end.start, end.end, "crc of all data differs", "summary")
        self._is_data, at, messages = False, end.end, self._messages
        problem = self._summary_problem(at)
        if problem:
            yield Damage(at, self.size, problem, "summary" if self._is_closed else "torn")
            return
        while at < self.size - len(MAGIC):
            try:
                piece = self.read_piece(at)
            except _Problem as error:
                yield Damage(at, self.size, str(error), "summary")
                return
            totals = piece.records[0] if piece.records else None
            if isinstance(totals, Statistics) and totals.message_count != messages and not self._is_damaged:
                yield Damage(at, at, f"{messages} messages of {totals.message_count}", "lost")
            yield piece
            at = piece.end

    def _summary_problem(self, at: int) -> str:
        """Check everything from the end of the data to that of the file; return "" if it is sound."""
        rest = self._read(at, self.size - at)
        footer_at = len(rest) - FOOTER.size - len(MAGIC)
        if footer_at < 0 or not rest.endswith(MAGIC):
            return "an incomplete end"
        opcode, length, start, _, crc = FOOTER.unpack_from(rest, footer_at)
        if (opcode, length) != (Opcode.FOOTER, FOOTER.size - RECORD_HEADER.size):
            return "lengths at the end differ"
        if start not in (0, at) and not self._is_damaged:  # bytes before it may be lost or inserted
            return "the summary begins elsewhere"
        return (
            ""
            if crc in (0, zlib.crc32(rest[: footer_at + FOOTER.size - 4]))
            else "crc of the summary differs"
        )

    def _damage(self, at: int, problem: _Problem) -> Damage:
        """Describe damage, up to the next record that can be verified."""
        end = self._resume(at + 1)
        if at == 0:
            return Damage(0, end, "not a recording (an MCAP file begins otherwise)", "lost")
        kind: Kind = "lost"
        if problem.is_torn and end == self.size and not self._is_closed:
            kind = "cut" if self._is_compressed else "torn"
        return Damage(at, end, str(problem), kind)

    def _resume(self, at: int) -> int:
        """Return the byte offset of the next record that can be verified, or the end of the file."""
        overlap = RECORD_HEADER.size - 1
        while at < self.size:
            block = self._read(at, BLOCK + overlap)
            for match in CANDIDATE.finditer(block):
                if self._is_record(at + match.start()):
                    return at + match.start()
            at += BLOCK
        return self.size

    def _is_record(self, at: int) -> bool:
        keep = self._data_crc, self._messages, self._is_compressed, self._has_chunks
        try:
            record = (self.read_piece(at).records or (None,))[0]
        except _Problem:
            return False
        finally:
            self._data_crc, self._messages, self._is_compressed, self._has_chunks = keep
        if isinstance(record, Message):  # its content is JSON, unless the bytes only look like a message
            try:
                msgspec.json.decode(record.data, type=dict[str, msgspec.Raw])
            except (msgspec.DecodeError, UnicodeDecodeError):
                return False
        return True

    def _read(self, at: int, length: int) -> bytes:
        self._file.seek(at)
        return self._file.read(min(length, max(self.size - at, 0)))


def _announces_chunks(record: McapRecord) -> bool:
    """Return whether a record is the header of a recording that has all its messages in chunks."""
    return isinstance(record, Metadata) and record.metadata.get("format", UNCHECKED[0]) not in UNCHECKED
