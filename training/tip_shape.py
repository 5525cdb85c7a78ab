"""The shape of the tip network, as in `tip_network.c` and `tip_network.h`: window, layers, distribution."""

from pathlib import Path

__all__ = [
    "ACROSS",
    "BEHIND",
    "CHANNELS",
    "CONTEXT",
    "FAR_MM",
    "FAR_PX",
    "FEATURES",
    "FILE",
    "LANE_MM",
    "LAYERS",
    "MIN_SD_PX",
    "PLACE_SD_MM",
    "SIDE",
    "STEP_MM",
    "STEP_SD_PX",
    "TAPS",
    "USUAL_PX_PER_MM",
]

STEP_MM, BEHIND = 0.08, 50  # between stations; stations before the apparent tip
LANE_MM, SIDE = 0.05, 8  # between lanes; lanes on either side of the shaft's middle
ACROSS = 2 * SIDE + 1
CHANNELS, CONTEXT = 3, 3
FEATURES, TAPS, LAYERS = 24, 5, 4
USUAL_PX_PER_MM, MIN_SD_PX = 18.0, 0.1
PLACE_SD_MM, STEP_SD_PX = 0.05, (0.3, 1.0)
FAR_MM, FAR_PX = 0.3, 2.5  # what is further off than both is far

FILE = Path(__file__).parent.parent / "haptigraph" / "models" / "tip_network.npy"
"""What the shipped network has learned."""
