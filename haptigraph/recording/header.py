"""The metadata records of a recording: its header with a checksum, and what a recovery had to leave out."""

import hashlib
import os
from contextlib import suppress
from pathlib import Path

import msgspec
from mcap.opcode import Opcode
from mcap.records import Metadata
from msgspec import Struct

from haptigraph.errors import BadInput
from haptigraph.recording.records import DAMAGE, parse_record
from haptigraph.recording.schema import READABLE, UNCHECKED, RunInfo

__all__ = [
    "Losses",
    "failure_losses",
    "header_record",
    "is_header",
    "is_losses",
    "losses_at_end",
    "losses_record",
    "losses_sentence",
    "read_header",
    "read_losses",
]

HEADER = "haptigraph"
LOSSES = "haptigraph.recovery"
DIGEST = "sha256"
MAX_LOSSES_BYTES = 8192


class Losses(Struct, frozen=True):
    """What is missing in a recording that was recovered from a damaged one."""

    missing: str
    """Numbers of the missing steps, as far as they are known: "3, 9-12"; empty: none."""
    damage: str
    """Where the original was damaged."""
    images: str = ""
    """How many images are missing, because their video is; empty: none."""
    failure: str = ""
    """Why and after which step its recorder failed, although the run went on; empty: it did not."""


def header_record(info: RunInfo) -> Metadata:
    """Return the header as an MCAP record, with the SHA-256 of its fields."""
    fields = {key: str(value) for key, value in msgspec.to_builtins(info).items()}
    return Metadata(HEADER, {**fields, DIGEST: _digest(fields)})


def losses_record(losses: Losses) -> Metadata:
    """Return an MCAP record that says what is missing."""
    return Metadata(LOSSES, msgspec.to_builtins(losses))


def losses_sentence(losses: Losses) -> str:
    """Return what is missing as a sentence for users."""
    if losses.failure and not (losses.damage or losses.missing or losses.images):
        return losses.failure
    failure = f"; {losses.failure}" if losses.failure else ""
    images = f"; missing: {losses.images} images, because their video was damaged" if losses.images else ""
    if losses.missing:
        return f"missing: step {losses.missing} of a damaged recording (the first is 0){images}{failure}"
    steps = "no step before the last one is missing, but there was damage; steps at the end may be missing"
    return f"{steps}{images}{failure}"


def failure_losses(reason: str, steps: int) -> Losses:
    """Return the losses of a recording whose recorder failed after some steps."""
    return Losses(
        "", "", failure=f"the recorder failed after step {steps - 1} ({reason}); later steps are lost"
    )


def is_header(record: object) -> bool:
    """Return whether an MCAP record is the header of a recording."""
    return isinstance(record, Metadata) and record.name == HEADER


def is_losses(record: object) -> bool:
    """Return whether an MCAP record says what is missing."""
    return isinstance(record, Metadata) and record.name == LOSSES


def read_header(record: Metadata, path: Path) -> RunInfo:
    """Return the header in an MCAP record, after a check of its checksums.

    Raises:
        BadInput: If it is damaged, or of another format; `path` names the recording.
    """
    fields = dict(record.metadata)
    digest = fields.pop(DIGEST, None)
    try:
        info = msgspec.convert(fields, RunInfo, strict=False)
    except (msgspec.ValidationError, OverflowError) as error:
        raise BadInput(f"header cannot be read: {error}", path) from None
    if digest != _digest(fields) and not (digest is None and info.format in UNCHECKED):
        raise BadInput("header is damaged (its SHA-256 differs)", path)
    if info.format not in READABLE:
        raise BadInput(f"recording format {info.format!r}; this version reads {', '.join(READABLE)}", path)
    optional = [name for name in ("robot_setup", "device_profile") if getattr(info, name)]
    for name in ("procedure", "registration", *optional):
        if hashlib.sha256(getattr(info, name).encode()).hexdigest() != getattr(info, f"{name}_sha256"):
            raise BadInput(f"header is damaged (the SHA-256 of its {name} differs)", path)
    try:
        msgspec.json.decode(info.config, type=dict[str, msgspec.Raw])
    except msgspec.DecodeError as error:
        raise BadInput(f"header cannot be read: configuration: {error}", path) from None
    return info


def read_losses(record: Metadata, path: Path) -> Losses:
    """Return what an MCAP record says is missing.

    Raises:
        BadInput: If it cannot be read; `path` names the recording.
    """
    try:
        return msgspec.convert(record.metadata, Losses)
    except msgspec.ValidationError as error:
        raise BadInput(f"its record of losses cannot be read: {error}", path) from None


def losses_at_end(path: Path) -> Losses | None:
    """Return what the last record of an incomplete recording says is missing; None if it says nothing."""
    with path.open("rb") as file:
        size = file.seek(0, os.SEEK_END)
        file.seek(max(size - MAX_LOSSES_BYTES, 0))
        tail = file.read()
    for at in range(len(tail)):
        start = at + 9  # behind opcode and length
        is_last = (
            tail[at] == Opcode.METADATA
            and int.from_bytes(tail[at + 1 : start], "little") == len(tail) - start
        )
        if is_last:
            with suppress(*DAMAGE):
                (record,) = parse_record(Opcode.METADATA, tail[start:])
                if isinstance(record, Metadata) and is_losses(record):
                    return read_losses(record, path)
    return None


def _digest(fields: dict[str, str]) -> str:
    return hashlib.sha256(msgspec.json.encode(sorted(fields.items()))).hexdigest()
