"""Say in words where two messages differ: each as JSON -> the parts that the other does not have.

Or by how much: the largest difference of two numbers, if nothing but numbers differs.
"""

from typing import Any

import msgspec

__all__ = ["differing_parts", "largest_difference"]

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


def largest_difference(before: Any, after: Any) -> float | None:
    """Return the largest difference of numbers with decimals; None if anything else differs.

    Args:
        before: A message of plain values.
        after: Another one.
    """
    if isinstance(before, float) and isinstance(after, float):
        return abs(before - after)
    if isinstance(before, dict) and isinstance(after, dict):
        pairs = zip(before.values(), after.values(), strict=False) if list(before) == list(after) else None
    elif isinstance(before, list | tuple) and isinstance(after, list | tuple):
        pairs = zip(before, after, strict=False) if len(before) == len(after) else None
    else:
        return 0.0 if before == after else None
    if pairs is None:
        return None
    found = [largest_difference(*pair) for pair in pairs]
    numbers = [each for each in found if each is not None]
    return max(numbers, default=0.0) if len(numbers) == len(found) else None


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
