"""The needle's pose over time: a Kalman filter that weighs every measurement by its uncertainty.

State: the shaft's angle and its rate, the tip's depth and its rate, and where the needle really pivots, as
an offset from the registered trocar; all in pixels and radians. A shaft seen on a short length alone has an
uncertain angle, but its error goes with an error of where it passes the trocar; knowing the pivot takes
most of it away. Motion is loosely modelled, so that a sharp measurement is taken as it is: no lag. Plain
numbers: four are too few to be worth an array.
"""

import math
from collections.abc import Sequence

from haptigraph.perception.needle.rectify import Line

__all__ = ["PoseFilter"]

TURNING_RAD_S2 = 5.2  # deviation of the acceleration that a hand's tremor and moves reach
MOVING_MM_S2 = 346.0
RCM_MM = 0.15  # registration error and play of the trocar
RCM_MEMORY = 0.9995  # per image; the rest goes back to the registered place
OFFSET_FLOOR_PX, ANGLE_FLOOR_RAD = 0.1, 0.0003  # what light and shape of the metal do to the edges
START_RAD, START_RAD_S, START_MM, START_MM_S = 0.5, 0.5, 20.0, 30.0  # deviations when first seen

Row = Sequence[float]


class PoseFilter:
    """Follow one needle.

    Args:
        px_per_mm: Scale.
    """

    def __init__(self, px_per_mm: float) -> None:
        self._px_per_mm = px_per_mm
        self._free_px2 = (RCM_MM * px_per_mm) ** 2  # of a pivot that no needle has shown yet
        self.reset()

    def reset(self) -> None:
        """Forget the needle and its pivot."""
        self._state = [0.0] * 4  # angle, its rate, and where the needle pivots (x, y)
        self._covariance = [[0.0] * 4 for _ in range(4)]
        self._covariance[2][2] = self._covariance[3][3] = self._free_px2
        self._depth = _Depth(0.0, 0.0)
        self._free: Line | None = None  # where the needle was seen before it is in the trocar
        self.is_tracking = False

    def lose(self) -> None:
        """Forget the needle, but not where it pivots."""
        self.is_tracking = False
        _, _, *rcm = self._covariance
        self._covariance = [[0.0] * 4, [0.0] * 4, *([0.0, 0.0, *row[2:]] for row in rcm)]

    def predict(self, elapsed_s: float) -> tuple[Line, float]:
        """Move on in time; return the expected line and the tip's depth along it [px]."""
        angle, rate, x, y = self._state
        self._state = [angle + elapsed_s * rate, rate, RCM_MEMORY * x, RCM_MEMORY * y]
        angle_rad2, both, rate2 = _unsteady(TURNING_RAD_S2, elapsed_s)
        forgotten = (1 - RCM_MEMORY**2) * self._free_px2
        rows = [_moved(row, elapsed_s) for row in self._covariance]
        columns = [_moved(column, elapsed_s) for column in zip(*rows, strict=True)]
        columns[0][0] += angle_rad2
        columns[0][1] += both
        columns[1][0] += both
        columns[1][1] += rate2
        columns[2][2] += forgotten
        columns[3][3] += forgotten
        self._covariance = columns
        self._depth.predict(elapsed_s)
        return self.line, self._depth.px

    def update(
        self,
        line: Line,
        line_covariance: tuple[float, float, float],
        depth_px: float,
        depth_sd_px: float,
        is_pivoting: bool,
    ) -> None:
        """Take in a measurement.

        Args:
            line: The fitted line.
            line_covariance: Of (offset_px, offset_px), (offset_px, angle_rad) and (angle_rad, angle_rad).
            depth_px: The tip along the line.
            depth_sd_px: Of it.
            is_pivoting: Whether the needle is in the trocar; before, it may pass it anywhere.
        """
        if not self.is_tracking:
            self._begin(line.angle_rad, depth_px)
        self._depth.update(depth_px, depth_sd_px)
        offset_px2, both, angle_rad2 = line_covariance
        offset_px2, angle_rad2 = offset_px2 + OFFSET_FLOOR_PX**2, angle_rad2 + ANGLE_FLOOR_RAD**2
        self._take((1.0, 0.0, 0.0, 0.0), line.angle_rad, angle_rad2)
        self._free = None if is_pivoting else line
        if is_pivoting:  # what the offset tells beyond the angle: its error goes with the angle's
            share = both / angle_rad2
            beyond = -share, 0.0, *line.normal
            self._take(beyond, line.offset_px - share * line.angle_rad, offset_px2 - share * both)

    def _take(self, observe: Row, seen: float, variance: float) -> None:
        """Take in one number that the state tells, but for some noise."""
        weighed = [_dot(row, observe) for row in self._covariance]
        surprise, variance = seen - _dot(self._state, observe), variance + _dot(weighed, observe)
        gain = [value / variance for value in weighed]
        self._state = [value + by * surprise for value, by in zip(self._state, gain, strict=True)]
        self._covariance = [
            [value - by * other for value, other in zip(row, weighed, strict=True)]
            for row, by in zip(self._covariance, gain, strict=True)
        ]

    def _begin(self, angle_rad: float, depth_px: float) -> None:
        self.lose()
        self._state[:2] = angle_rad, 0.0
        self._covariance[0][0], self._covariance[1][1] = START_RAD**2, START_RAD_S**2
        self._depth = _Depth(depth_px, self._px_per_mm)
        self.is_tracking = True

    @property
    def line(self) -> Line:
        """The shaft."""
        if self._free is not None:
            return self._free
        angle, _, x, y = self._state
        nx, ny = Line(angle, 0.0).normal
        return Line(angle, nx * x + ny * y)

    @property
    def depth_px(self) -> float:
        """The tip along the line."""
        return self._depth.px

    @property
    def angle_sd_rad(self) -> float:
        """Standard deviation of the angle."""
        return math.sqrt(self._covariance[0][0])

    def tip_sd_px(self) -> float:
        """Standard deviation of the tip: along and across the shaft together."""
        nx, ny = (0.0, 0.0) if self._free is not None else self.line.normal
        across = self._depth.px, 0.0, nx, ny
        spread = [_dot(row, across) for row in self._covariance]
        return math.sqrt(self._depth.variance_px2 + _dot(spread, across))


def _dot(one: Row, other: Row) -> float:
    return one[0] * other[0] + one[1] * other[1] + one[2] * other[2] + one[3] * other[3]


def _moved(row: Row, elapsed_s: float) -> list[float]:
    """Return what becomes of one row or column of the covariance."""
    return [row[0] + elapsed_s * row[1], row[1], RCM_MEMORY * row[2], RCM_MEMORY * row[3]]


def _unsteady(acceleration: float, elapsed_s: float) -> tuple[float, float, float]:
    """Return what unsteady motion adds to the (co)variances of a place, of both, and of its rate.

    Acceleration is white noise: it may change at any moment. Were it the same from one image to the next, a
    sharp measurement would tell it, and with it a rate that swings from side to side after every sudden move.
    """
    rate2 = (acceleration * elapsed_s) ** 2
    return rate2 * elapsed_s**2 / 3, rate2 * elapsed_s / 2, rate2


class _Depth:
    """How far in the tip is, and how fast it moves: the same filter, for two numbers.

    Args:
        px: Where it is seen first.
        px_per_mm: Scale.
    """

    def __init__(self, px: float, px_per_mm: float) -> None:
        self.px, self.variance_px2 = px, (START_MM * px_per_mm) ** 2
        self._moving_px_s2 = MOVING_MM_S2 * px_per_mm
        self._rate, self._both, self._rate_variance = 0.0, 0.0, (START_MM_S * px_per_mm) ** 2

    def predict(self, elapsed_s: float) -> None:
        depth_px2, both, rate2 = _unsteady(self._moving_px_s2, elapsed_s)
        self.px += elapsed_s * self._rate
        self.variance_px2 += elapsed_s * (2 * self._both + elapsed_s * self._rate_variance) + depth_px2
        self._both += elapsed_s * self._rate_variance + both
        self._rate_variance += rate2

    def update(self, seen_px: float, sd_px: float) -> None:
        surprise, variance = seen_px - self.px, self.variance_px2 + sd_px**2
        gain, rate_gain = self.variance_px2 / variance, self._both / variance
        self.px += gain * surprise
        self._rate += rate_gain * surprise
        self._rate_variance -= rate_gain * self._both
        self._both -= gain * self._both
        self.variance_px2 -= gain * self.variance_px2
