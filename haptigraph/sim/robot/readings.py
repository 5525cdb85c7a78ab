"""What the simulated robot reports of itself: tips of the simulation -> samples in the robot's base.

They come at the robot's own rate, with noise of its joints, after a latency, and from a base that is turned
and displaced against the eye. Optional errors: a needle that is bent, a calibration that has slipped, stamps
that lag.
"""

from typing import Annotated

import numpy as np
from msgspec import Meta, Struct
from numpy.typing import NDArray

from haptigraph.geometry import Vec
from haptigraph.messages import RobotSample

__all__ = ["ReadingsShape", "SimulatedReadings", "robot_setup_text"]

EYE_FROM_BASE_TURN = (0.36, 0.48, -0.64, 0.48)  # an arbitrary rotation, from the eye frame to the base
GLOBE_IN_BASE_MM = (41.0, -87.0, 132.0)
NS_PER_S = 1e9
MS_PER_S = 1e3
Offset = tuple[Annotated[float, Meta(ge=-20, le=20)], Annotated[float, Meta(ge=-20, le=20)]]


class ReadingsShape(Struct, frozen=True, forbid_unknown_fields=True):
    """The [readings] table of a scenario."""

    rate_hz: Annotated[float, Meta(ge=10, le=1000)] = 250.0
    latency_ms: Annotated[float, Meta(ge=0, le=1000)] = 20.0
    """From measurement to arrival; the stamp is that of the measurement."""
    latency_sd_ms: Annotated[float, Meta(ge=0, le=100)] = 5.0
    noise_mm: Annotated[float, Meta(ge=0, le=1)] = 0.01
    """Standard deviation of the tip per axis: joints of 0.02 degrees at 28 mm."""
    stamps_late_ms: Annotated[float, Meta(ge=-5000, le=5000)] = 0.0
    """How much later than measured poses are stamped: clocks that disagree."""
    bend_mm: Annotated[float, Meta(ge=-5, le=5)] = 0.0
    """How far the needle's tip is bent to the left of its shaft, as the robot does not know."""
    bends_at_s: Annotated[float, Meta(ge=0, le=86_400)] = 0.0
    slip_mm: Offset = (0.0, 0.0)
    """Error of the calibration, in the section."""
    tip_sd_mm: Annotated[float, Meta(ge=0, le=10)] = 0.1
    """Standard deviation that the calibration states."""


def robot_setup_text(shape: ReadingsShape, rcm_mm: Vec) -> str:
    """Return the simulated robot's robot.toml.

    Args:
        shape: States the standard deviation.
        rcm_mm: The trocar, eye frame.
    """
    rcm = _in_base(np.array([[*rcm_mm, 0.0]]))[0]
    return (
        f"format = 1\n\n[rcm]\nat_mm = {_list(rcm)}\n\n[eye]\ntranslation_mm = {_list(GLOBE_IN_BASE_MM)}\n"
        f"quaternion = {_list(EYE_FROM_BASE_TURN)}\ntip_sd_mm = {shape.tip_sd_mm:g}\n"
    )


class SimulatedReadings:
    """Sample the robot between images.

    Args:
        shape: Rate, latency and errors.
        seed: Of noise and latency.
    """

    def __init__(self, shape: ReadingsShape, seed: int) -> None:
        self._shape, self._seed = shape, seed
        self.restart()

    def restart(self) -> None:
        """Return to time 0."""
        self._random = np.random.default_rng((self._seed, 32))
        self._waiting: list[tuple[float, RobotSample]] = []
        self._number = 0
        self._last: tuple[float, Vec] | None = None

    def advance(self, time_s: float, tip_mm: Vec, direction: Vec) -> tuple[RobotSample, ...]:
        """Return the samples that have arrived since the previous call, oldest first.

        Args:
            time_s: Of the image.
            tip_mm: The needle's tip at that time, eye frame; it moves straight between two images.
            direction: Of the shaft, into the eye.
        """
        since_s, since_mm = self._last or (time_s, tip_mm)
        self._last = time_s, tip_mm
        count = int(time_s * self._shape.rate_hz + 1e-6) + 1 - self._number
        times_s = (self._number + np.arange(count)) / self._shape.rate_hz
        self._number += count
        share = (times_s - since_s) / max(time_s - since_s, 1e-9)
        tips_mm = np.outer(1 - share, since_mm) + np.outer(share, tip_mm)
        self._waiting += self._samples(times_s, tips_mm, direction)
        arrived = [sample for at_s, sample in self._waiting if at_s <= time_s]
        self._waiting = [(at_s, sample) for at_s, sample in self._waiting if at_s > time_s]
        return tuple(sorted(arrived, key=lambda sample: sample.stamp_ns))

    def _samples(
        self, times_s: NDArray[np.float64], tips_mm: NDArray[np.float64], direction: Vec
    ) -> list[tuple[float, RobotSample]]:
        """Return when each measurement arrives [s], and the measurement."""
        shape, count = self._shape, len(times_s)
        bend_mm = np.where(times_s >= shape.bends_at_s, shape.bend_mm, 0.0)
        straight_mm = tips_mm - np.outer(bend_mm, (-direction[1], direction[0]))
        noisy = np.column_stack((straight_mm, np.zeros(count)))
        noisy += self._random.normal(0.0, shape.noise_mm, (count, 3))
        late_s = self._random.normal(shape.latency_ms, shape.latency_sd_ms, count).clip(0) / MS_PER_S
        seen_mm = np.add(noisy, (*shape.slip_mm, 0.0))
        quaternion = _tool_quaternion(direction)
        return [
            (
                at_s + delay_s,
                RobotSample(
                    round((at_s + shape.stamps_late_ms / MS_PER_S) * NS_PER_S),
                    (base[0], base[1], base[2]),
                    quaternion,
                    operating="ENABLED",
                    eye_tip_mm=(eye[0], eye[1], eye[2]),
                    eye_tip_sd_mm=shape.tip_sd_mm,
                ),
            )
            for at_s, delay_s, base, eye in zip(
                times_s.tolist(), late_s.tolist(), _in_base(noisy).tolist(), seen_mm.tolist(), strict=True
            )
        ]


def _in_base(points_mm: NDArray[np.float64]) -> NDArray[np.float64]:
    """Transform points (n, 3) from the eye frame to the robot's base."""
    return points_mm @ _rotation(EYE_FROM_BASE_TURN).T + GLOBE_IN_BASE_MM


def _rotation(quaternion: tuple[float, float, float, float]) -> NDArray[np.float64]:
    x, y, z, w = np.array(quaternion) / np.linalg.norm(quaternion)
    axis = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    turned: NDArray[np.float64] = np.eye(3) + 2 * w * axis + 2 * axis @ axis
    return turned


def _tool_quaternion(direction: Vec) -> tuple[float, float, float, float]:
    """Return the rotation from the tool's frame, whose z runs along the shaft, to the base."""
    u, v = direction
    norm = np.sqrt(2.0)  # turns z to (u, v, 0): half a turn about the axis between the two
    ax, ay, az = u / norm, v / norm, 1 / norm
    bx, by, bz, bw = EYE_FROM_BASE_TURN
    x = bw * ax + by * az - bz * ay
    y = bw * ay + bz * ax - bx * az
    z = bw * az + bx * ay - by * ax
    w = -(bx * ax + by * ay + bz * az)
    return float(x), float(y), float(z), float(w)


def _list(numbers: object) -> str:
    values = np.array(numbers, dtype=np.float64).tolist()
    return f"[{', '.join(f'{value:.9g}' for value in values)}]"
