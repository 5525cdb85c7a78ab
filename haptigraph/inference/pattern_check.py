"""Check the haptic grammar of a procedure: patterns that can be felt, numbers that can follow a measure.

Knows no state.
"""

from collections.abc import Iterable

from haptigraph.errors import unknown_name
from haptigraph.graph import Schema
from haptigraph.messages import Pattern
from haptigraph.toml_document import Document

__all__ = ["check_known", "check_pattern"]

MOST = {"amplitude": 1, "on_ms": 3_600_000, "off_ms": 3_600_000, "count": 1000, "rearm_ms": 3_600_000}
MOST_FOLLOWED = {"amplitude": 1.0, "frequency_hz": 1000.0, "rate_hz": 100.0}


def check_known(document: Document, what: str, name: str, valid: Iterable[str], path: str) -> None:
    """Raise BadInput, with the names that would be valid, if a name is not among them."""
    valid = list(valid)
    if name not in valid:
        raise document.error(unknown_name(what, name, valid), path)


def check_pattern(document: Document, pattern: Pattern, path: str, schema: Schema) -> None:
    """Raise BadInput if a pattern cannot be felt, or follows what it cannot.

    Args:
        document: The procedure's file.
        pattern: Of its grammar.
        path: Where it stands there.
        schema: Whose relations' measures may be followed.
    """
    _check_numbers(document, pattern, path)
    _check_follow(document, pattern, path, schema)


def _check_numbers(document: Document, pattern: Pattern, path: str) -> None:
    needed = {
        "off": (),
        "continuous": ("amplitude",),
        "pulses": ("amplitude", "on_ms", "off_ms"),
        "bursts": ("amplitude", "on_ms", "off_ms", "count"),
    }[pattern.kind]
    for key in MOST:
        value = getattr(pattern, key)
        if key in needed and (value <= 0 or (key != "amplitude" and value < 1)):
            least = "above 0" if key == "amplitude" else "of at least 1"
            raise document.error(f"{pattern.kind} needs {key} {least}, found {value:g}", f"{path}.{key}")
        if value < 0:
            raise document.error(f"{key} must not be negative, found {value:g}", f"{path}.{key}")
        if value > MOST[key]:
            raise document.error(f"{key} must be at most {MOST[key]:g}, found {value:g}", f"{path}.{key}")
        if key not in needed and value != 0 and (key, pattern.kind) != ("rearm_ms", "bursts"):
            raise document.error(f"{pattern.kind} has no {key}, found {value:g}", f"{path}.{key}")
    if pattern.frequency_hz < 0:
        raise document.error(
            f"frequency_hz must not be negative, found {pattern.frequency_hz:g}", f"{path}.frequency_hz"
        )


def _check_follow(document: Document, pattern: Pattern, path: str, schema: Schema) -> None:
    keys = {"continuous": ("amplitude", "frequency_hz"), "pulses": tuple(MOST_FOLLOWED)}.get(pattern.kind, ())
    measures = {schema.measure_name(relation) for relation in schema.relations}
    for number, follow in enumerate(pattern.follow):
        place = f"{path}.follow[{number}]"
        if follow.key not in keys or follow.key in (other.key for other in pattern.follow[:number]):
            valid = f"each of {', '.join(keys)} once" if keys else "nothing"
            raise document.error(
                f"{follow.key} cannot follow here; of {pattern.kind} {valid} can", f"{place}.key"
            )
        check_known(document, "measure", follow.measure, measures, f"{place}.measure")
        if follow.start[0] == follow.end[0]:
            raise document.error(f"start and end are both at {follow.end[0]:g}", f"{place}.end")
        for end, (_, value) in (("start", follow.start), ("end", follow.end)):
            most = MOST_FOLLOWED[follow.key]
            if follow.key == "rate_hz":
                most = min(most, 1000.0 / (pattern.on_ms + 1))
            if not 0 < value <= most:
                raise document.error(
                    f"{follow.key} must be above 0 and at most {most:.4g}, found {value:g}", f"{place}.{end}"
                )
        if not 0.1 <= follow.curve <= 10:
            raise document.error(f"curve must be 0.1 to 10, found {follow.curve:g}", f"{place}.curve")
        if follow.dead_band < 0:
            raise document.error(f"dead_band is negative, found {follow.dead_band:g}", f"{place}.dead_band")
