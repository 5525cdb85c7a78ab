"""Load what `touch` commands name: a procedure's pattern, a TOML file with a pattern, or a foreign file."""

import json
import re
from pathlib import Path

from msgspec import Struct, field

from haptigraph.assemble import load_procedure, procedure_names
from haptigraph.errors import BadInput, unknown_name
from haptigraph.haptics.formats.envelope import Envelope, enveloped
from haptigraph.haptics.formats.files import FORMATS, checked, read_envelope
from haptigraph.haptics.formats.fitting import fit
from haptigraph.inference.checks import check_numbers
from haptigraph.messages import Pattern
from haptigraph.toml_document import Document, convert

__all__ = ["Touch", "load_touch", "name_of", "pattern_toml", "patterns_in", "touch_from"]


class Touch(Struct, frozen=True):
    """A vibration, with the pattern that plays it if there is one."""

    name: str
    envelope: Envelope
    pattern: Pattern | None


class _Patterns(Struct, frozen=True):
    patterns: tuple[Pattern, ...] = field(name="pattern", default=())


def load_touch(subject: str, length_ms: float) -> Touch:
    """Load a vibration.

    Args:
        subject: PROCEDURE:PATTERN, FILE.toml:PATTERN, FILE.toml with one pattern, or a file of `FORMATS`.
        length_ms: How long a pattern that does not end by itself lasts.

    Raises:
        BadInput: If it does not exist or is not valid.
    """
    if Path(subject).suffix.lower() in FORMATS:
        return touch_from(read_envelope(subject), name_of(subject))
    source, _, name = subject.rpartition(":")
    if source.endswith(".toml") or source in procedure_names():
        pattern = _named(_patterns(source), name, source)
    elif subject.endswith(".toml"):
        patterns = _patterns(subject)
        if len(patterns) != 1:
            names = ", ".join(each.name for each in patterns) or "none"
            raise BadInput(f"{len(patterns)} patterns; name one, as in {subject}:PATTERN: {names}", subject)
        pattern = patterns[0]
    else:
        valid = f"PROCEDURE:PATTERN, FILE.toml, FILE.toml:PATTERN or a file that ends in {', '.join(FORMATS)}"
        raise BadInput(f"is no vibration; valid: {valid}", subject)
    envelope = checked(enveloped(pattern, length_ms), subject)
    follows = tuple(
        f"{follow.key} follows {follow.measure}, here at its plain value" for follow in pattern.follow
    )
    return Touch(
        pattern.name,
        Envelope(envelope.amplitude, envelope.frequency_hz, (), envelope.repeats, follows),
        pattern,
    )


def touch_from(envelope: Envelope, name: str) -> Touch:
    """Return an envelope with the pattern that plays it within 1 % and 2 ms, if there is one."""
    fitted = fit(envelope, name)
    return Touch(name, envelope, fitted.pattern if fitted.is_exact else None)


def name_of(path: str | Path) -> str:
    """Return a pattern's name for a file."""
    return re.sub(r"\W+", "_", Path(path).stem, flags=re.ASCII).strip("_") or "pattern"


def pattern_toml(pattern: Pattern, origin: str) -> str:
    """Return a pattern as the [[pattern]] table of a procedure.

    Args:
        pattern: Without numbers that follow a measure.
        origin: Where it is from, for the comment.
    """
    lines = [
        f"# From {origin}, by haptigraph touch convert; a [[state]] of a procedure feels it.",
        "[[pattern]]",
    ]
    lines += [f"{key} = {json.dumps(getattr(pattern, key), ensure_ascii=False)}" for key in ("name", "kind")]
    for key in ("amplitude", "frequency_hz", "on_ms", "off_ms", "count"):
        if value := getattr(pattern, key):
            lines.append(f"{key} = {value!r}")
    return "\n".join(lines) + "\n"


def patterns_in(document: Document) -> tuple[Pattern, ...]:
    """Return the [[pattern]] tables of a TOML document, without the rest.

    Raises:
        BadInput: If one is not valid.
    """
    patterns = convert({"pattern": document.data.get("pattern", [])}, _Patterns, document.error).patterns
    for number, pattern in enumerate(patterns):
        check_numbers(document, pattern, f"pattern[{number}]")
    return patterns


def _patterns(source: str) -> tuple[Pattern, ...]:
    """Return the patterns of a procedure, or of a file that has patterns only."""
    if not source.endswith(".toml"):
        return load_procedure(source).patterns
    document = Document.read(source)
    if "procedure" in document.data:
        return load_procedure(source).patterns
    return patterns_in(document)


def _named(patterns: tuple[Pattern, ...], name: str, source: str) -> Pattern:
    for pattern in patterns:
        if pattern.name == name:
            return pattern
    raise BadInput(unknown_name("pattern", name, (pattern.name for pattern in patterns)), source)
