"""Say in words where two messages differ: each as JSON -> the parts that the other does not have."""

from typing import Any

import msgspec

__all__ = ["differing_parts"]

MAX_PARTS = 4
NOTHING = "(nothing else)"


def differing_parts(before: bytes, after: bytes) -> tuple[str, str]:
    """Return the parts of each of two messages that differ, the first few of them.

    Args:
        before: A message as JSON.
        after: Another one.
    """
    parts = [dict(_parts(msgspec.json.decode(message))) for message in (before, after)]
    differing = [name for name in {**parts[0], **parts[1]} if parts[0].get(name) != parts[1].get(name)]
    texts = [[f"{name}{each[name]}" for name in differing if name in each] for each in parts]
    first, second = (_joined(each) for each in texts)
    return first, second


def _parts(value: Any, path: str = "") -> list[tuple[str, str]]:
    """Return (name, value) of everything in a message; items of lists are named by their content."""
    if isinstance(value, dict) and set(value) == {"subject", "predicate", "object"}:
        return [(f"{path}{value['subject']} {value['predicate']} {value['object']}", "")]
    if isinstance(value, dict):
        return [part for key, each in value.items() for part in _parts(each, f"{path}{key} ")]
    if isinstance(value, list) and any(isinstance(each, dict) for each in value):
        return [part for each in value for part in _parts(each, path)]
    text = ", ".join(map(str, value)) if isinstance(value, list) else str(value)
    return [(path, text)]


def _joined(parts: list[str]) -> str:
    more = f"; and {len(parts) - MAX_PARTS} more" if len(parts) > MAX_PARTS else ""
    return "; ".join(part.strip() for part in parts[:MAX_PARTS]) + more or NOTHING
