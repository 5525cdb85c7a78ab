"""Check the names in a procedure and its haptic patterns: perceptible, and able to follow their measures."""

from collections.abc import Iterable

from haptigraph.errors import unknown_name
from haptigraph.graph import Names, Schema, Triplet
from haptigraph.messages import Pattern
from haptigraph.toml_document import Document

__all__ = ["check_name", "check_numbers", "check_pattern", "check_relations", "check_unique"]

MAX = {"amplitude": 1, "on_ms": 3_600_000, "off_ms": 3_600_000, "count": 1000, "rearm_ms": 3_600_000}
MAX_FOLLOWED = {"amplitude": 1.0, "frequency_hz": 1000.0, "rate_hz": 100.0}


def check_name(document: Document, what: str, name: str, valid: Iterable[str], path: str) -> None:
    """Raise BadInput, listing the valid names, if a name is not among them."""
    valid = list(valid)
    if name not in valid:
        raise document.error(unknown_name(what, name, valid), path)


def check_relations(document: Document, schema: Schema, used: Iterable[Names], path: str) -> None:
    """Raise BadInput, listing the valid relations, if the schema lacks one that is used."""
    relations = [relation.names for relation in schema.relations]
    for names in used:
        if names not in relations:
            valid = " ".join(str(Triplet(*relation)) for relation in relations)
            raise document.error(f"{Triplet(*names)} is no relation; there are: {valid}", path)


def check_unique(document: Document, kind: str, names: list[str]) -> None:
    """Raise BadInput unless there are names, none of them empty or given twice; `kind` is their table."""
    if not names:
        raise document.error(f"no [[{kind}]]; at least one is needed", "procedure")
    for number, name in enumerate(names):
        if not name.strip():
            raise document.error(f"a {kind} without a name", f"{kind}[{number}].name")
        if name in names[:number]:
            raise document.error(f"a second {kind} {name!r}; names must differ", f"{kind}[{number}].name")


def check_pattern(document: Document, pattern: Pattern, path: str, schema: Schema) -> None:
    """Raise BadInput if a pattern is imperceptible or cannot follow its measures.

    Args:
        document: The file of the procedure.
        pattern: The pattern.
        path: Its key path in the file.
        schema: Defines the measures that can be followed.
    """
    check_numbers(document, pattern, path)
    _check_follow(document, pattern, path, schema)


def check_numbers(document: Document, pattern: Pattern, path: str) -> None:
    """Raise BadInput if a pattern lacks a number of its kind, or has one that is not of it.

    Args:
        document: The file of the pattern.
        pattern: The pattern.
        path: Its key path in the file.
    """
    required = {
        "off": (),
        "continuous": ("amplitude",),
        "pulses": ("amplitude", "on_ms", "off_ms"),
        "bursts": ("amplitude", "on_ms", "off_ms", "count"),
    }[pattern.kind]
    for key in MAX:
        value = getattr(pattern, key)
        if key in required and (value <= 0 or (key != "amplitude" and value < 1)):
            minimum = "above 0" if key == "amplitude" else "of at least 1"
            raise document.error(f"{pattern.kind} needs {key} {minimum}, found {value:g}", f"{path}.{key}")
        if value < 0:
            raise document.error(f"{key} must not be negative, found {value:g}", f"{path}.{key}")
        if value > MAX[key]:
            raise document.error(f"{key} must be at most {MAX[key]:g}, found {value:g}", f"{path}.{key}")
        if key not in required and value != 0 and (key, pattern.kind) != ("rearm_ms", "bursts"):
            raise document.error(f"{pattern.kind} has no {key}, found {value:g}", f"{path}.{key}")
    if pattern.frequency_hz < 0:
        raise document.error(
            f"frequency_hz must not be negative, found {pattern.frequency_hz:g}", f"{path}.frequency_hz"
        )


def _check_follow(document: Document, pattern: Pattern, path: str, schema: Schema) -> None:
    keys = {"continuous": ("amplitude", "frequency_hz"), "pulses": tuple(MAX_FOLLOWED)}.get(pattern.kind, ())
    for number, follow in enumerate(pattern.follow):
        follow_path = f"{path}.follow[{number}]"
        if follow.key not in keys or follow.key in (other.key for other in pattern.follow[:number]):
            valid = f"each of {', '.join(keys)} once" if keys else "nothing"
            raise document.error(
                f"{follow.key} cannot follow a measure here; {pattern.kind} allows {valid}",
                f"{follow_path}.key",
            )
        check_name(document, "measure", follow.measure, schema.measure_names, f"{follow_path}.measure")
        if follow.start[0] == follow.end[0]:
            raise document.error(f"start and end are both at {follow.end[0]:g}", f"{follow_path}.end")
        for end, (_, value) in (("start", follow.start), ("end", follow.end)):
            maximum = MAX_FOLLOWED[follow.key]
            if follow.key == "rate_hz":
                maximum = min(maximum, 1000.0 / (pattern.on_ms + 1))
            if not 0 < value <= maximum:
                problem = f"{follow.key} must be above 0 and at most {maximum:.4g}, found {value:g}"
                raise document.error(problem, f"{follow_path}.{end}")
        if not 0.1 <= follow.curve <= 10:
            raise document.error(f"curve must be 0.1 to 10, found {follow.curve:g}", f"{follow_path}.curve")
        if follow.dead_band < 0:
            problem = f"dead_band must not be negative, found {follow.dead_band:g}"
            raise document.error(problem, f"{follow_path}.dead_band")
