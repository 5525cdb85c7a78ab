"""The needle's pose over time: a Kalman filter that weighs each measurement by its uncertainty.

State: the shaft's angle and its rate, the tip's depth and its rate, and the remote centre of motion (RCM), as
an offset from the registered trocar; all in pixels and radians. The angle of a shaft that is visible on a
short length is uncertain, but its error is correlated with that of the offset from the trocar; knowing the
RCM removes most of it. Motion is modelled loosely, so that a sharp measurement is followed without lag. Plain
numbers: four are too few to be worth an array, and a loop over them takes five times as long.
"""

import math

from haptigraph.perception.needle.rectify import Line

__all__ = ["PoseFilter"]

TURNING_RAD_S2 = 5.2  # sd of the acceleration that a hand's tremor and moves reach
MOVING_MM_S2 = 346.0
RCM_MM = 0.15  # registration error and play of the trocar
RCM_MEMORY = 0.9995  # per image; the rest goes back to the registered trocar
OFFSET_FLOOR_PX, ANGLE_FLOOR_RAD = 0.1, 0.0003  # what light and shape of the metal do to the edges
START_RAD, START_RAD_S, START_MM, START_MM_S = 0.5, 0.5, 20.0, 30.0  # sd when first detected

Four = tuple[float, float, float, float]


class PoseFilter:
    """Filter the pose of one needle.

    Args:
        px_per_mm: Scale.
    """

    def __init__(self, px_per_mm: float) -> None:
        self._px_per_mm = px_per_mm
        self._rcm_px2 = (RCM_MM * px_per_mm) ** 2  # prior variance of the RCM
        self.reset()

    def reset(self) -> None:
        """Forget the needle and its RCM."""
        self._state: Four = (0.0, 0.0, 0.0, 0.0)  # angle, its rate, and RCM (x, y)
        # Its covariance's upper triangle, here and in `lose`: a for the angle, r for its rate, x and y.
        self._xx, self._xy, self._yy = self._rcm_px2, 0.0, self._rcm_px2
        self._depth = _Depth(0.0, 0.0)
        self._free_line: Line | None = None  # the last measurement, until the needle is in the trocar
        self.lose()

    def lose(self) -> None:
        """Forget the needle, but not its RCM."""
        self.is_tracking = False
        self._aa = self._ar = self._ax = self._ay = self._rr = self._rx = self._ry = 0.0

    def predict(self, elapsed_s: float) -> tuple[Line, float]:
        """Advance in time; return the expected line and the tip's depth along it [px]."""
        angle, rate, x, y = self._state
        self._state = angle + elapsed_s * rate, rate, RCM_MEMORY * x, RCM_MEMORY * y
        angle_rad2, both, rate2 = _process_noise(TURNING_RAD_S2, elapsed_s)
        forgotten = (1 - RCM_MEMORY**2) * self._rcm_px2
        self._aa += elapsed_s * (2 * self._ar + elapsed_s * self._rr) + angle_rad2
        self._ar += elapsed_s * self._rr + both
        self._rr += rate2
        self._ax = RCM_MEMORY * (self._ax + elapsed_s * self._rx)
        self._ay = RCM_MEMORY * (self._ay + elapsed_s * self._ry)
        self._rx *= RCM_MEMORY
        self._ry *= RCM_MEMORY
        self._xx = RCM_MEMORY**2 * self._xx + forgotten
        self._xy *= RCM_MEMORY**2
        self._yy = RCM_MEMORY**2 * self._yy + forgotten
        self._depth.predict(elapsed_s)
        return self.line, self._depth.px

    def update(
        self,
        line: Line,
        line_covariance: tuple[float, float, float],
        depth_px: float,
        depth_sd_px: float,
        is_in_trocar: bool,
    ) -> None:
        """Update the state with a measurement.

        Args:
            line: The fitted line.
            line_covariance: Of (offset_px, offset_px), (offset_px, angle_rad) and (angle_rad, angle_rad).
            depth_px: The tip along the line.
            depth_sd_px: Its standard deviation.
            is_in_trocar: Whether the needle turns about the RCM; before, it may pass the trocar anywhere.
        """
        if not self.is_tracking:
            self._begin(line.angle_rad, depth_px)
        self._depth.update(depth_px, depth_sd_px)
        offset_px2, both, angle_rad2 = line_covariance
        offset_px2, angle_rad2 = offset_px2 + OFFSET_FLOOR_PX**2, angle_rad2 + ANGLE_FLOOR_RAD**2
        self._update_state(1.0, 0.0, 0.0, line.angle_rad, angle_rad2)
        self._free_line = None if is_in_trocar else line
        if is_in_trocar:  # the part of the offset that is not correlated with the angle
            share = both / angle_rad2
            beyond_px = line.offset_px - share * line.angle_rad
            self._update_state(-share, *line.normal, beyond_px, offset_px2 - share * both)

    def _update_state(
        self, by_angle: float, by_x: float, by_y: float, measured: float, variance: float
    ) -> None:
        """Update the state with one number: a linear combination of angle and RCM, plus noise."""
        a, r, x, y = self._covariance_with(by_angle, by_x, by_y)
        angle, rate, rcm_x, rcm_y = self._state
        innovation = measured - (by_angle * angle + by_x * rcm_x + by_y * rcm_y)
        variance += by_angle * a + by_x * x + by_y * y
        by_a, by_r, x_gain, y_gain = a / variance, r / variance, x / variance, y / variance
        self._state = (
            *(angle + by_a * innovation, rate + by_r * innovation),
            *(rcm_x + x_gain * innovation, rcm_y + y_gain * innovation),
        )
        self._aa -= by_a * a
        self._ar -= by_a * r
        self._ax -= by_a * x
        self._ay -= by_a * y
        self._rr -= by_r * r
        self._rx -= by_r * x
        self._ry -= by_r * y
        self._xx -= x_gain * x
        self._xy -= x_gain * y
        self._yy -= y_gain * y

    def _covariance_with(self, by_angle: float, by_x: float, by_y: float) -> Four:
        """Return the covariance of the state with a linear combination of angle and RCM."""
        return (
            by_angle * self._aa + by_x * self._ax + by_y * self._ay,
            by_angle * self._ar + by_x * self._rx + by_y * self._ry,
            by_angle * self._ax + by_x * self._xx + by_y * self._xy,
            by_angle * self._ay + by_x * self._xy + by_y * self._yy,
        )

    def _begin(self, angle_rad: float, depth_px: float) -> None:
        self.lose()
        _, _, x, y = self._state
        self._state = angle_rad, 0.0, x, y
        self._aa, self._rr = START_RAD**2, START_RAD_S**2
        self._depth = _Depth(depth_px, self._px_per_mm)
        self.is_tracking = True

    @property
    def line(self) -> Line:
        """The shaft."""
        if self._free_line is not None:
            return self._free_line
        angle, _, x, y = self._state
        return Line(angle, math.cos(angle) * y - math.sin(angle) * x)

    @property
    def depth_px(self) -> float:
        """The tip along the line."""
        return self._depth.px

    @property
    def angle_sd_rad(self) -> float:
        """Standard deviation of the angle."""
        return math.sqrt(self._aa)

    def tip_sd_px(self, measured_sd_px: float = 0.0) -> float:
        """Return the standard deviation of the tip, along and across the shaft together.

        Args:
            measured_sd_px: That of the last measurement along the shaft, with what is alike in all images and
                does not average out.
        """
        (nx, ny), depth_px = (0.0, 0.0) if self._free_line is not None else self.line.normal, self._depth.px
        a, _, x, y = self._covariance_with(depth_px, nx, ny)
        across_px2 = depth_px * a + nx * x + ny * y
        return math.sqrt(max(self._depth.variance_px2, measured_sd_px**2) + across_px2)


def _process_noise(acceleration: float, elapsed_s: float) -> tuple[float, float, float]:
    """Return what motion adds to the variance of a value, its covariance with its rate, and that of the rate.

    Acceleration is white noise: it may change at any moment. If it were constant between two images, a sharp
    measurement would determine it, and so a rate that swings from side to side after each sudden move.
    """
    rate2 = (acceleration * elapsed_s) ** 2
    return rate2 * elapsed_s**2 / 3, rate2 * elapsed_s / 2, rate2


class _Depth:
    """The tip's depth and its rate: the same filter, for two numbers.

    Args:
        px: The first measurement.
        px_per_mm: Scale.
    """

    def __init__(self, px: float, px_per_mm: float) -> None:
        self.px, self.variance_px2 = px, (START_MM * px_per_mm) ** 2
        self._moving_px_s2 = MOVING_MM_S2 * px_per_mm
        self._rate, self._both, self._rate_variance = 0.0, 0.0, (START_MM_S * px_per_mm) ** 2

    def predict(self, elapsed_s: float) -> None:
        depth_px2, both, rate2 = _process_noise(self._moving_px_s2, elapsed_s)
        self.px += elapsed_s * self._rate
        self.variance_px2 += elapsed_s * (2 * self._both + elapsed_s * self._rate_variance) + depth_px2
        self._both += elapsed_s * self._rate_variance + both
        self._rate_variance += rate2

    def update(self, measured_px: float, sd_px: float) -> None:
        innovation, variance = measured_px - self.px, self.variance_px2 + sd_px**2
        gain, rate_gain = self.variance_px2 / variance, self._both / variance
        self.px += gain * innovation
        self._rate += rate_gain * innovation
        self._rate_variance -= rate_gain * self._both
        self._both -= gain * self._both
        self.variance_px2 -= gain * self.variance_px2
