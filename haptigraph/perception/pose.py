"""The needle's pose over time: a Kalman filter that weighs every measurement by its uncertainty.

State: the shaft's angle and its rate, the tip's depth and its rate, and where the needle really pivots, as
an offset from the registered trocar; all in pixels and radians. A shaft seen on a short length alone has an
uncertain angle, but its error goes with an error of where it passes the trocar; knowing the pivot takes
most of it away. Motion is loosely modelled, so that a sharp measurement is taken as it is: no lag.
"""

import numpy as np
from numpy.typing import NDArray

from haptigraph.perception.strip import Line

__all__ = ["PoseFilter"]

TURNING_RAD_S2 = 6.0  # deviation of the acceleration that a hand's tremor and moves reach
MOVING_MM_S2 = 400.0
PIVOT_MM = 0.15  # registration error and play of the trocar
PIVOT_MEMORY = 0.9995  # per image; the rest goes back to the registered place
LINE_FLOOR = (0.1, 0.0003)  # px, rad: what light and shape of the metal do to the edges
START_RATES = (0.5, 30.0)  # rad/s, mm/s

Matrix = NDArray[np.float64]


class PoseFilter:
    """Follow one needle.

    Args:
        px_per_mm: Scale.
    """

    def __init__(self, px_per_mm: float) -> None:
        self._px_per_mm = px_per_mm
        self._elapsed_s = -1.0
        self._moved = np.eye(6), np.zeros((6, 6))
        self.reset()

    def reset(self) -> None:
        """Forget the needle and its pivot."""
        self._state = np.zeros(6)
        self._covariance = np.zeros((6, 6))
        self._covariance[4:, 4:] = np.eye(2) * (PIVOT_MM * self._px_per_mm) ** 2
        self._free_offset_px: float | None = None
        self.is_tracking = False

    def lose(self) -> None:
        """Forget the needle, but not where it pivots."""
        self.is_tracking = False
        self._covariance[:4] = self._covariance[:, :4] = 0

    def predict(self, elapsed_s: float) -> tuple[Line, float]:
        """Move on in time; return the expected line and the tip's depth along it [px]."""
        move, push = self._motion(elapsed_s)
        self._state = move @ self._state
        self._covariance = move @ self._covariance @ move.T + push
        return self.line, float(self._state[2])

    def _motion(self, elapsed_s: float) -> tuple[Matrix, Matrix]:
        """Return the change of state, and what it adds to the covariance."""
        if elapsed_s != self._elapsed_s:
            move = np.diag([1.0, 1.0, 1.0, 1.0, PIVOT_MEMORY, PIVOT_MEMORY])
            move[0, 1] = move[2, 3] = elapsed_s
            push = np.zeros((6, 6))
            for first, strength in ((0, TURNING_RAD_S2), (2, MOVING_MM_S2 * self._px_per_mm)):
                by = strength * np.array([elapsed_s**2 / 2, elapsed_s])
                push[first : first + 2, first : first + 2] = np.outer(by, by)
            push[4:, 4:] = np.eye(2) * (1 - PIVOT_MEMORY**2) * (PIVOT_MM * self._px_per_mm) ** 2
            self._elapsed_s, self._moved = elapsed_s, (move, push)
        return self._moved

    def update(
        self,
        line: Line,
        line_covariance: Matrix,
        depth_px: float,
        depth_deviation_px: float,
        is_pivoting: bool,
    ) -> None:
        """Take in a measurement.

        Args:
            line: The fitted line.
            line_covariance: Of (offset_px, angle_rad), (2, 2).
            depth_px: The tip along the line.
            depth_deviation_px: Of it.
            is_pivoting: Whether the needle is in the trocar; before, it may pass it anywhere.
        """
        if not self.is_tracking:
            self._begin(line.angle_rad, depth_px)
        self._free_offset_px = None if is_pivoting else line.offset_px
        nx, ny = line.normal if is_pivoting else (0.0, 0.0)
        observe = np.zeros((3, 6))
        observe[0, 4:] = nx, ny
        observe[1, 0] = observe[2, 2] = 1
        noise = np.zeros((3, 3))
        noise[:2, :2], noise[2, 2] = line_covariance + np.diag(np.square(LINE_FLOOR)), depth_deviation_px**2
        offset_px = line.offset_px if is_pivoting else 0.0
        surprise = np.array([offset_px, line.angle_rad, depth_px]) - observe @ self._state
        weighed = self._covariance @ observe.T
        gain = np.linalg.solve(observe @ weighed + noise, weighed.T).T
        self._state = self._state + gain @ surprise
        self._covariance = self._covariance - gain @ weighed.T

    def _begin(self, angle_rad: float, depth_px: float) -> None:
        self._state[:4] = angle_rad, 0.0, depth_px, 0.0
        spread = np.array([0.5, START_RATES[0], 20 * self._px_per_mm, START_RATES[1] * self._px_per_mm])
        self._covariance[:4] = self._covariance[:, :4] = 0
        self._covariance[range(4), range(4)] = spread**2
        self.is_tracking = True

    @property
    def line(self) -> Line:
        """The shaft."""
        angle = float(self._state[0])
        if self._free_offset_px is not None:
            return Line(angle, self._free_offset_px)
        nx, ny = Line(angle, 0.0).normal
        return Line(angle, float(nx * self._state[4] + ny * self._state[5]))

    @property
    def depth_px(self) -> float:
        """The tip along the line."""
        return float(self._state[2])

    @property
    def angle_deviation_rad(self) -> float:
        """Standard deviation of the angle."""
        return float(np.sqrt(self._covariance[0, 0]))

    def tip_deviation_px(self) -> float:
        """Standard deviation of the tip: along and across the shaft together."""
        nx, ny = (0.0, 0.0) if self._free_offset_px is not None else self.line.normal
        across = np.array([self._state[2], 0, 0, 0, nx, ny])
        return float(np.sqrt(self._covariance[2, 2] + across @ self._covariance @ across))
