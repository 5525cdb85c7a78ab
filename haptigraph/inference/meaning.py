"""What a state means to the surgeon: its name and what is felt in it -> a kind.

A procedure says it (`kind`). Where it does not, the kind follows from the paper's states, else from the
pattern that is felt.
"""

from typing import Literal, TypeAlias

from haptigraph.messages import UNKNOWN, Pattern

__all__ = ["PAPER_KINDS", "Kind", "assumed_kind"]

Kind: TypeAlias = Literal["alarm", "guidance", "success", "neutral", "unseen"]
"""alarm: stop; guidance: correct the motion; success: the place that was aimed at; neutral: all is well;
unseen: nothing can be said, because something is not detected."""

PAPER_KINDS: dict[str, Kind] = {
    UNKNOWN: "unseen",
    "tip_not_visible": "unseen",
    "retinal_contact": "alarm",
    "target_hit": "success",
    "misaligned_retinal_approach": "guidance",
    "aligned_retinal_approach": "neutral",
    "misaligned_intraocular_navigation": "guidance",
    "aligned_intraocular_navigation": "neutral",
    "outside_eye": "neutral",
}
"""Of the paper's states and the two in which nothing is known."""


def assumed_kind(state: str, pattern: Pattern, max_amplitude: float, *, has_absent: bool) -> Kind:
    """Return the kind of a state whose procedure does not say it.

    Args:
        state: Its name.
        pattern: What is felt in it.
        max_amplitude: The largest amplitude of all patterns.
        has_absent: Whether its rule names entities that must be absent.
    """
    if state in PAPER_KINDS:
        return PAPER_KINDS[state]
    if pattern.kind == "off":
        return "unseen" if has_absent else "neutral"
    if pattern.kind == "pulses" and pattern.amplitude == max_amplitude:
        return "alarm"
    return "success" if pattern.kind == "bursts" else "guidance"
