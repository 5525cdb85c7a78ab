"""Convert vibrations between patterns and foreign files, and report the error of what is read back."""

from collections.abc import Iterator
from pathlib import Path

from msgspec import Struct

from haptigraph.analysis.actuators import numbers_text
from haptigraph.analysis.exporting.writing import write_new
from haptigraph.analysis.touch.loading import (
    Touch,
    load_touch,
    name_of,
    pattern_toml,
    patterns_in,
    touch_from,
)
from haptigraph.assemble import load_procedure, procedure_names
from haptigraph.errors import BadInput
from haptigraph.haptics.formats.envelope import Difference, difference, enveloped
from haptigraph.haptics.formats.files import FORMATS, checked, format_of
from haptigraph.haptics.formats.fitting import MAX_TIMING_MS, Fit, fit
from haptigraph.messages import Pattern
from haptigraph.toml_document import Document

__all__ = ["Conversion", "convert_touch", "difference_text", "pattern_text", "round_trips"]


class Conversion(Struct, frozen=True):
    """What was written."""

    source: Touch
    written: Touch
    """As it is read back."""
    error: Difference


def convert_touch(subject: str, output: str, length_ms: float, *, approximate: bool) -> Conversion:
    """Convert a vibration to a new file, and read that back.

    Args:
        subject: As `load_touch` takes it.
        output: The file; .toml, or an ending in `FORMATS`.
        length_ms: How long a pattern that does not end by itself lasts in a file.
        approximate: Whether a pattern is written even if it does not fit.

    Raises:
        BadInput: If it cannot be read or written, or no pattern fits.
    """
    is_pattern = output.endswith(".toml")
    form = None if is_pattern else format_of(output)
    source = load_touch(subject, length_ms)
    if form is None:
        fitted = fit(source.envelope, name_of(output))
        if not fitted.is_exact and not approximate:
            raise BadInput(_misfit(fitted), subject)
        text = pattern_toml(fitted.pattern, Path(subject).name)
        (pattern,) = patterns_in(Document(text, output))
        write_new(output, text.encode())
        written = Touch(pattern.name, enveloped(pattern, source.envelope.duration_ms), pattern)
    else:
        content = form.write(source.envelope, source.name)
        written = touch_from(checked(form.read(content, output), output), source.name)
        write_new(output, content)
    return Conversion(source, written, difference(source.envelope, written.envelope))


def round_trips(length_ms: float) -> Iterator[tuple[str, int, int, Difference]]:
    """Yield each format, the number of shipped patterns, how many keep their kind, and the largest errors."""
    patterns = [pattern for name in procedure_names() for pattern in load_procedure(name).patterns]
    for ending, form in FORMATS.items():
        errors, kept = [], 0
        for pattern in patterns:
            envelope = enveloped(pattern, length_ms)
            back = form.read(form.write(envelope, pattern.name), ending)
            fitted = fit(back, pattern.name).pattern
            errors.append(difference(envelope, enveloped(fitted, length_ms)))
            kept += fitted.kind == pattern.kind
        worst = Difference(
            max(error.amplitude for error in errors),
            max(error.timing_ms for error in errors),
            max(error.frequency_hz for error in errors),
        )
        yield ending, len(patterns), kept, worst


def difference_text(error: Difference) -> str:
    """Return a difference as a clause."""
    timing = f"{error.timing_ms:.3g} ms" if error.timing_ms != float("inf") else "another rhythm"
    choice = "chosen by the device in one of them" if error.frequency_hz == float("inf") else ""
    frequency = choice or f"{error.frequency_hz:.3g} Hz"
    return f"amplitude {100 * error.amplitude:.3g} %, timing {timing}, frequency {frequency}"


def pattern_text(pattern: Pattern) -> str:
    """Return a pattern's kind and numbers as a clause."""
    return f"{pattern.kind} of {numbers_text(pattern)}" if pattern.amplitude else pattern.kind


def _misfit(fitted: Fit) -> str:
    what = "rhythm" if fitted.error.timing_ms > MAX_TIMING_MS else "amplitude"
    error = difference_text(fitted.error)
    return (
        f"no pattern has its {what}; {pattern_text(fitted.pattern)} is off by {error}; "
        "--approximate writes that"
    )
