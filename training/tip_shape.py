"""The shape of the tip network's window, as in `tip_network.c` and `tip_network.h`."""

__all__ = ["ACROSS", "BEHIND", "CHANNELS", "LANE_MM", "SIDE", "STEP_MM"]

STEP_MM, BEHIND = 0.08, 50  # between stations; stations before the apparent tip
LANE_MM, SIDE = 0.05, 8  # between lanes; lanes on either side of the shaft's middle
ACROSS = 2 * SIDE + 1
CHANNELS = 3
