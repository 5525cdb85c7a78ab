"""Who gets what in which order: conditions and targets, drawn from a seed, balanced over participants.

Pure functions of (seed, participant's place). Chance is SHA-256 of seed and place, not a generator, so that
the same seed draws the same order with any version of Python and NumPy.
"""

import hashlib
from collections.abc import Sequence
from typing import Literal, TypeAlias, TypeVar

__all__ = ["Order", "drawn", "order_of", "round_of", "shuffled", "targets_of", "williams"]

T = TypeVar("T")
Order: TypeAlias = Literal["balanced", "random", "fixed"]


def drawn(*what: object) -> int:
    """Return a number in [0, 2^63) that anyone can draw again from the same words."""
    digest = hashlib.sha256("/".join(str(word) for word in what).encode()).digest()
    return int.from_bytes(digest[:8]) >> 1


def shuffled(items: Sequence[T], *what: object) -> list[T]:
    """Return items in an order drawn by the words `what`."""
    places = sorted(range(len(items)), key=lambda place: drawn(*what, place))
    return [items[place] for place in places]


def round_of(count: int, slot: int) -> int:
    """Return the full round of a balanced order of `count` treatments that a place (from 0) lies in."""
    return slot // len(williams(count))


def williams(count: int) -> list[tuple[int, ...]]:
    """Return the rows of a balanced Latin square for `count` treatments.

    Every treatment stands equally often at every position and follows every other equally often. Even counts
    take `count` rows, odd ones the rows and their mirror images (E. J. Williams: Experimental designs
    balanced for the estimation of residual effects of treatments, Aust. J. Sci. Res. A 2, 1949).
    """
    first = [0]
    for step in range(1, count):
        first.append((step + 1) // 2 if step % 2 else count - step // 2)
    rows = [tuple((place + shift) % count for place in first) for shift in range(count)]
    return rows if count % 2 == 0 or count == 1 else rows + [row[::-1] for row in rows]


def order_of(items: Sequence[T], slot: int, seed: int, how: Order, what: str) -> list[T]:
    """Return the order in which one participant meets items.

    Args:
        items: In the protocol's order.
        slot: The participant's place in the study, from 0.
        seed: Of the study.
        how: "balanced": rows of a Williams square, each of them once in every full round of participants, in
            an order drawn per round; "random": drawn for each participant alone; "fixed": as they stand.
        what: What is ordered; other words draw other orders.
    """
    if how == "fixed":
        return list(items)
    if how == "random":
        return shuffled(items, seed, what, "random", slot)
    rows = williams(len(items))
    this_round, place = divmod(slot, len(rows))
    row = shuffled(rows, seed, what, "balanced", this_round)[place]
    return [items[number] for number in row]


def targets_of(
    names: Sequence[str], trials: int, slot: int, seed: int, how: Order, group: str = ""
) -> list[str]:
    """Return the targets of one participant's trials: each once before any comes again, never twice running.

    Args:
        names: Of the targets.
        trials: How many are needed.
        slot: The participant's place in the group, from 0.
        seed: Of the study.
        how: As for conditions.
        group: Within which targets are balanced: participants with one order of conditions, so that
            conditions and targets do not come to depend on each other.
    """
    chosen: list[str] = []
    while len(chosen) < trials:
        deck = order_of(names, slot, seed, how, f"targets {group} {len(chosen) // len(names)}")
        if chosen and len(deck) > 1 and deck[0] == chosen[-1]:
            deck = [*deck[1:], deck[0]]
        chosen += deck
    return chosen[:trials]
