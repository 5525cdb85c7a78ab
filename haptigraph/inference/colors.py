"""Colours of states, in figures, in diagrams and on pages: kinds of states -> one colour and its ink each.

As in the paper: red for contact, green for the target, warm for misaligned, blue for aligned; ours: grey and
violet for what is not seen. States of one kind differ in shade, in order of priority.
"""

from collections.abc import Mapping, Sequence

from msgspec import Struct

from haptigraph.inference.color_vision import ink_on
from haptigraph.inference.meaning import PAPER_KINDS, Kind
from haptigraph.inference.procedure import Procedure

__all__ = ["PAPER_PALETTE", "Paint", "palette", "palette_of"]

SHADES: dict[Kind, tuple[str, ...]] = {
    "alarm": ("#d03a3a", "#8f1d2c"),
    "guidance": ("#e08a2e", "#f3c58b"),
    "success": ("#3a9d5d", "#8fd0a5"),
    "neutral": ("#2f6fb3", "#9cc5e8", "#efefef"),
    "unseen": ("#c9c9c9", "#b7a6cf"),
}
"""From the state of highest priority to that of lowest; those between are mixed."""


class Paint(Struct, frozen=True):
    """The colour of a state, and that of text on it."""

    color: str
    ink: str


def palette(procedure: Procedure) -> dict[str, Paint]:
    """Return the paint of every state of a procedure."""
    own = {state.name: state.color for state in procedure.states if state.color}
    return palette_of(procedure.kinds, own)


def palette_of(kinds: Mapping[str, Kind], own: Mapping[str, str] | None = None) -> dict[str, Paint]:
    """Return the paint of states by their kinds.

    Args:
        kinds: The kind of each state, in order of priority.
        own: Colours that replace those of the kind.
    """
    paints = {}
    for name, kind in kinds.items():
        alike = [other for other in kinds if kinds[other] == kind]
        share = alike.index(name) / max(len(alike) - 1, 1)
        color = (own or {}).get(name) or _shade(SHADES[kind], share)
        paints[name] = Paint(color, ink_on(color))
    return paints


def _shade(stops: Sequence[str], share: float) -> str:
    """Return the colour at a share of the way from the first stop to the last."""
    place = share * (len(stops) - 1)
    at = min(int(place), len(stops) - 2)
    parts = ([int(stop[channel : channel + 2], 16) for stop in stops[at : at + 2]] for channel in (1, 3, 5))
    return "#" + "".join(f"{round(low + (high - low) * (place - at)):02x}" for low, high in parts)


PAPER_PALETTE = palette_of(PAPER_KINDS)
