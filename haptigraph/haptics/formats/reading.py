"""Read foreign files with care: their size, JSON, and numbers in their range."""

import itertools
import json
from collections.abc import Mapping, Sequence
from typing import Any

from haptigraph.errors import BadInput
from haptigraph.haptics.formats.curve import Curve
from haptigraph.haptics.formats.envelope import MAX_MS

__all__ = ["MAX_POINTS", "Json", "normalised", "points_checked", "read_json", "to_bytes", "to_hz"]

MAX_POINTS = 20_000
MAX_SHOWN = 40
LOW_HZ, HIGH_HZ = 50.0, 300.0
"""What 0 and 1 mean on a scale without a unit. Neither Apple nor Meta publishes a frequency; MPEG's reference
software takes 65 to 300 Hz for AHAP. From 50 Hz on, all shipped patterns are on the scale."""


class Json:
    """A value in a JSON document that knows its place.

    Args:
        value: The parsed value.
        file: Name of the file, for messages.
        place: Key path of the value.
    """

    def __init__(self, value: Any, file: str, place: str = "") -> None:
        self.value, self.file, self.place = value, file, place

    def __getitem__(self, key: str) -> "Json":
        """Return a member; an error if there is none."""
        found = self.get(key)
        if found is None:
            raise self.error(f"key {key!r} is missing")
        return found

    def get(self, key: str) -> "Json | None":
        """Return a member of a table, or None."""
        table = self.value
        if not isinstance(table, Mapping):
            raise self.error(f"expected a table, found {_shown(table)}")
        place = f"{self.place}.{key}".lstrip(".")
        return Json(table[key], self.file, place) if key in table else None

    def items(self) -> "list[Json]":
        """Return the members of a list."""
        if not isinstance(self.value, list):
            raise self.error(f"expected a list, found {_shown(self.value)}")
        if len(self.value) > MAX_POINTS:
            raise self.error(f"{len(self.value)} entries; at most {MAX_POINTS}")
        return [Json(item, self.file, f"{self.place}[{at}]") for at, item in enumerate(self.value)]

    def text(self, default: str | None = None) -> str:
        """Return a string."""
        if not isinstance(self.value, str):
            if default is not None:
                return default
            raise self.error(f"expected a string, found {_shown(self.value)}")
        return self.value

    def number(self, low: float, high: float) -> float:
        """Return a number in a range, limits included."""
        found = self.value
        if isinstance(found, bool) or not isinstance(found, int | float) or not low <= found <= high:
            raise self.error(f"expected a number from {low:g} to {high:g}, found {_shown(found)}")
        return float(found)

    def time_ms(self, unit_ms: float = 1000.0) -> float:
        """Return a time [ms] that is written in another unit, in seconds unless stated."""
        time_ms = self.number(0.0, MAX_MS / unit_ms) * unit_ms
        return round(time_ms, 9)  # 0.3 s is 300 ms

    def error(self, problem: str) -> BadInput:
        """Return the error for a problem here."""
        return BadInput(problem, self.file, self.place)


def read_json(content: bytes, file: str) -> Json:
    """Parse a JSON document.

    Raises:
        BadInput: If it is not JSON.
    """
    try:
        return Json(json.loads(content.decode("utf-8-sig")), file)
    except UnicodeDecodeError as error:
        raise BadInput(f"not UTF-8 text (byte {error.start})", file) from None
    except json.JSONDecodeError as error:
        raise BadInput(f"not JSON: {error.msg}", file, f"line {error.lineno}") from None
    except (RecursionError, ValueError):  # a number of thousands of digits
        raise BadInput("not JSON that can be read: nested too deeply, or a number too long", file) from None


def to_bytes(document: object) -> bytes:
    """Return a JSON document as the content of a file."""
    return (json.dumps(document, indent=1) + "\n").encode()


def points_checked(points: Sequence[tuple[float, float]], source: Json) -> Curve:
    """Return points as a curve if no time goes back."""
    for at, (before, after) in enumerate(itertools.pairwise(points), 1):
        if after[0] < before[0]:
            problem = f"time {after[0] / 1e3:g} s comes after {before[0] / 1e3:g} s; times must not decrease"
            raise BadInput(problem, source.file, f"{source.place}[{at}]")
    return tuple(points)


def to_hz(share: float) -> float:
    """Return a frequency [Hz] for a value from 0 to 1 of a scale without a unit."""
    return round(LOW_HZ + share * (HIGH_HZ - LOW_HZ), 6)


def normalised(frequency_hz: float) -> float:
    """Return the value from 0 to 1 for a frequency [Hz]; the nearest one if the scale does not have it."""
    return round(min(max((frequency_hz - LOW_HZ) / (HIGH_HZ - LOW_HZ), 0.0), 1.0), 9)


def _shown(value: object) -> str:
    """Return a value in a message, shortened."""
    text = repr(value)
    return text if len(text) <= MAX_SHOWN else f"{text[:MAX_SHOWN]}..."
