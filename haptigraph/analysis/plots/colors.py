"""Colours of surgical states, in figures and on the live page."""

import colorsys

__all__ = ["OTHER_COLORS", "STATE_COLORS", "ink_on", "state_color"]

STATE_COLORS = {
    "unknown": "#c9c9c9",
    "tip_not_visible": "#b7a6cf",
    "retinal_contact": "#d03a3a",
    "target_hit": "#3a9d5d",
    "misaligned_retinal_approach": "#e08a2e",
    "aligned_retinal_approach": "#2f6fb3",
    "misaligned_intraocular_navigation": "#f3c58b",
    "aligned_intraocular_navigation": "#9cc5e8",
    "outside_eye": "#efefef",
}
"""As in the paper: warm for misaligned, blue for aligned, red and green for contact and target; ours: violet
for a needle without a visible tip."""
OTHER_COLORS = {"near_rpe": "#d03a3a", "target_depth": "#3a9d5d"}


def state_color(state: str) -> str:
    """Return the colour of a state; derived from its name if the paper does not define one."""
    if state in STATE_COLORS | OTHER_COLORS:
        return (STATE_COLORS | OTHER_COLORS)[state]
    hue = sum(state.encode()) % 20 / 20
    return "#" + "".join(f"{round(255 * part):02x}" for part in colorsys.hls_to_rgb(hue, 0.6, 0.45))


def ink_on(state: str) -> str:
    """Return a text colour that is readable on a state's colour."""
    color = state_color(state)
    red, green, blue = (int(color[at : at + 2], 16) / 255 for at in (1, 3, 5))
    return "#ffffff" if 0.3 * red + 0.59 * green + 0.11 * blue < 0.55 else "#222222"
