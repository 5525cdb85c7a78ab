"""Counterbalancing: the order of conditions and targets of each participant, from a seed.

Pure functions of seed and slot. Random numbers are SHA-256 hashes, not a generator's output, so that the same
seed yields the same orders with any version of Python and NumPy.
"""

from collections.abc import Sequence
from typing import Literal, TypeAlias, TypeVar

from haptigraph.checksum import hashed_integer

__all__ = ["Order", "order_of", "round_of", "shuffled", "targets_of", "williams"]

T = TypeVar("T")
Order: TypeAlias = Literal["balanced", "random", "fixed"]


def shuffled(items: Sequence[T], *key: object) -> list[T]:
    """Return items in a pseudo-random order that depends on the key alone."""
    indices = sorted(range(len(items)), key=lambda index: hashed_integer(*key, index))
    return [items[index] for index in indices]


def round_of(count: int, slot: int) -> int:
    """Return the full round of a balanced order of `count` treatments to which a slot (from 0) belongs."""
    return slot // len(williams(count))


def williams(count: int) -> list[tuple[int, ...]]:
    """Return the rows of a balanced Latin square for `count` treatments.

    Every treatment occurs equally often at every position and follows every other equally often. Even counts
    take `count` rows, odd ones the rows and their mirror images (E. J. Williams: Experimental designs
    balanced for the estimation of residual effects of treatments, Aust. J. Sci. Res. A 2, 1949).
    """
    first = [0, *((step + 1) // 2 if step % 2 else count - step // 2 for step in range(1, count))]
    rows = [tuple((treatment + shift) % count for treatment in first) for shift in range(count)]
    return rows if count % 2 == 0 or count == 1 else rows + [row[::-1] for row in rows]


def order_of(items: Sequence[T], slot: int, seed: int, order: Order, purpose: str) -> list[T]:
    """Return the order in which one participant meets items.

    Args:
        items: In the protocol's order.
        slot: The participant's place in the counterbalancing, from 0.
        seed: The study's seed.
        order: "balanced": rows of a Williams square, each once per full round of participants, in an order
            drawn per round; "random": drawn for each participant; "fixed": as given.
        purpose: What is ordered; another purpose draws another order.
    """
    if order == "fixed":
        return list(items)
    if order == "random":
        return shuffled(items, seed, purpose, "random", slot)
    rows = williams(len(items))
    this_round, index = divmod(slot, len(rows))
    row = shuffled(rows, seed, purpose, "balanced", this_round)[index]
    return [items[number] for number in row]


def targets_of(
    names: Sequence[str], trials: int, slot: int, seed: int, order: Order, group: str = "", draw: int = 0
) -> list[str]:
    """Return the targets of one participant's trials: each once before any repeats, never twice in a row.

    Args:
        names: The targets' names.
        trials: The number of trials.
        slot: The participant's place in the group, from 0.
        seed: The study's seed.
        order: As for conditions.
        group: Participants within whom targets are balanced: those with the same order of conditions, so that
            conditions and targets are not confounded.
        draw: Number of the draw; each has other orders.
    """
    targets: list[str] = []
    again = f" draw {draw}" if draw else ""
    while len(targets) < trials:
        deck = order_of(names, slot, seed, order, f"targets {group} {len(targets) // len(names)}{again}")
        if targets and len(deck) > 1 and deck[0] == targets[-1]:
            deck = [*deck[1:], deck[0]]
        targets += deck
    return targets[:trials]
