"""The formats by the endings of their files: read and write whole files, within limits of size."""

from collections.abc import Callable
from pathlib import Path

from msgspec import Struct
from msgspec.structs import replace

from haptigraph.errors import BadInput, unknown_name
from haptigraph.haptics.formats import ahap, hjif, meta_haptic, wav
from haptigraph.haptics.formats.envelope import MAX_MS, Envelope
from haptigraph.haptics.formats.reading import MAX_POINTS

__all__ = ["FORMATS", "Format", "checked", "format_of", "read_envelope"]

MAX_TRANSIENTS = 2_000
MB = 1_000_000


class Format(Struct, frozen=True):
    """One file format."""

    title: str
    """What it is, and whose."""
    read: Callable[[bytes, str], Envelope]
    write: Callable[[Envelope, str], bytes]
    max_bytes: int = 8 * MB
    caution: str = ""
    """What a user must know before relying on a file, in one sentence."""


FORMATS = {
    ".haptic": Format("Meta Haptics Studio, version 1", meta_haptic.read, meta_haptic.write),
    ".ahap": Format("Apple Core Haptics", ahap.read, ahap.write),
    ".hjif": Format(
        "MPEG haptics (ISO/IEC 23090-31), JSON",
        hjif.read,
        hjif.write,
        caution="not checked against a reference reader",
    ),
    ".wav": Format("sound of a voice coil, PCM", wav.read, wav.write, max_bytes=72 * MB),
}


def format_of(path: str | Path) -> Format:
    """Return the format of a file by its ending.

    Raises:
        BadInput: If there is no such format.
    """
    ending = Path(path).suffix.lower()
    if ending not in FORMATS:
        raise BadInput(unknown_name("format", ending, FORMATS), path)
    return FORMATS[ending]


def read_envelope(path: str | Path) -> Envelope:
    """Read a file.

    Raises:
        BadInput: If it cannot be read, is too large or too long, or is not valid.
    """
    form = format_of(path)
    try:
        with Path(path).open("rb") as file:
            content = file.read(form.max_bytes + 1)
    except OSError as error:
        raise BadInput(f"cannot be read ({error.strerror})", path) from None
    if len(content) > form.max_bytes:
        raise BadInput(f"larger than {form.max_bytes // MB} MB", path)
    return checked(form.read(content, str(path)), str(path))


def checked(envelope: Envelope, file: str) -> Envelope:
    """Return an envelope whose transients are in order, if it is within the limits.

    Raises:
        BadInput: If it is too long or has too many points.
    """
    if envelope.duration_ms > MAX_MS:
        raise BadInput(f"lasts {envelope.duration_ms / 1e3:g} s; at most {MAX_MS / 1e3:g} s", file)
    points = len(envelope.amplitude) + len(envelope.frequency_hz)
    if points > 2 * MAX_POINTS:
        raise BadInput(f"{points} points of amplitude and frequency; at most {2 * MAX_POINTS}", file)
    if len(envelope.transients) > MAX_TRANSIENTS:
        raise BadInput(f"{len(envelope.transients)} transients; at most {MAX_TRANSIENTS}", file)
    return replace(envelope, transients=tuple(sorted(envelope.transients, key=lambda one: one.time_ms)))
