"""Exponential moving average over needle poses, the paper's smoothing (section II-B, step 3)."""

from haptigraph.geometry import Vec, unit

__all__ = ["MovingAverage"]


class MovingAverage:
    """Smooth tip and direction: s_t = (1 - alpha) s_{t-1} + alpha x_t.

    The first pose after `reset` is not smoothed. The lag is about (1 - alpha) / alpha images.

    Args:
        alpha: Weight of the new pose, in (0, 1]; 1 disables smoothing.
    """

    def __init__(self, alpha: float) -> None:
        self._alpha = alpha
        self._last: tuple[Vec, Vec] | None = None

    def __call__(self, tip_mm: Vec, direction: Vec) -> tuple[Vec, Vec]:
        """Return the smoothed tip [mm] and direction (length 1)."""
        if self._last is not None:
            tip_mm = self._mix(self._last[0], tip_mm)
            direction = unit(self._mix(self._last[1], direction))
        self._last = tip_mm, direction
        return self._last

    def reset(self) -> None:
        """Restart, as after the needle was lost."""
        self._last = None

    def _mix(self, old: Vec, new: Vec) -> Vec:
        keep = 1.0 - self._alpha
        return keep * old[0] + self._alpha * new[0], keep * old[1] + self._alpha * new[1]
