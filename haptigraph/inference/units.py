"""Numbers with units in a procedure: "700 um" -> 0.7, in the unit of the measure that it bounds."""

import math
import re
from fractions import Fraction
from typing import Any

from haptigraph.toml_document import Document

__all__ = ["UNITS", "to_numbers", "unit_of"]

UNITS: dict[str, tuple[str, Fraction]] = {
    "m": ("length", Fraction(1)),
    "cm": ("length", Fraction(1, 100)),
    "mm": ("length", Fraction(1, 1000)),
    "um": ("length", Fraction(1, 10**6)),
    "µm": ("length", Fraction(1, 10**6)),
    "deg": ("angle", Fraction(1)),
    "rad": ("angle", Fraction(180 / math.pi)),
    "s": ("time", Fraction(1)),
    "ms": ("time", Fraction(1, 1000)),
    "percent": ("share", Fraction(1)),
}
"""What each unit measures, and its size."""
BOUNDS = ("at_most", "below", "at_least", "above", "release")
QUANTITY = re.compile(r"\s*([+-]?\d+(?:\.\d*)?)\s*([a-zµ]+)\s*")


def unit_of(measure: str) -> str:
    """Return the unit of a measure: the suffix of its name."""
    return measure.rpartition("_")[2]


def to_numbers(document: Document) -> None:
    """Replace the bounds of relations and gaps that are written with a unit by numbers, in place.

    Raises:
        BadInput: If a unit is unknown or measures something else than the bound does.
    """
    for kind in ("relation", "gap"):
        tables = document.data.get(kind, ())
        for number, table in enumerate(tables if isinstance(tables, list) else ()):
            measure = table.get("measure") if isinstance(table, dict) else None
            for key in BOUNDS if isinstance(measure, str) else ():
                if isinstance(table.get(key), str):
                    path = f"{kind}[{number}].{key}"
                    table[key] = _number(document, path, table[key], unit_of(measure or ""))


def _number(document: Document, path: str, text: str, unit: str) -> Any:
    """Return a quantity in a unit; the text itself if that is none that this module knows."""
    if unit not in UNITS:
        return text
    sort, size = UNITS[unit]
    valid = [name for name, (other, _) in UNITS.items() if other == sort]
    found = QUANTITY.fullmatch(text)
    if found is None or found[2] not in valid:
        example = f'a number, or a number and a unit, such as "0.7 {unit}" (valid: {", ".join(valid)})'
        raise document.error(f"{path.rpartition('.')[2]}: expected {example}, found {text!r}", path)
    return float(Fraction(found[1]) * UNITS[found[2]][1] / size)
