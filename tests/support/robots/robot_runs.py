"""Simulated runs of a robot that holds a needle, without images: true motion, and what camera and robot report."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from haptigraph.robot.pose import ToolPose, Transform, quaternion_of

Floats = NDArray[np.float64]
TROCAR_MM = np.array([-7.0, 10.0])
TARGET_MM = np.array([1.5, -11.9, 0.0])
STEP_S = 0.004
CORRELATION_S = 0.3  # of the tracker's errors
TREMOR_HZ = (8.0, 12.0)


class SimulatedRun(NamedTuple):
    """What was recorded, and what is true."""

    image_s: Floats
    image_mm: Floats
    """Tips in the images, eye frame, (n, 2)."""
    robot_s: Floats
    """Stamps, late by the lag."""
    robot_mm: Floats
    """Tips in the base, (m, 3)."""
    robot_axes: Floats
    """Directions of the shaft in the base, (m, 3)."""
    lag_s: float
    eye_from_base: Transform
    rcm_mm: Floats
    """In the base."""


def random_transform(rng: np.random.Generator, reach_mm: float = 300.0) -> Transform:
    """Return any rotation and a translation."""
    q, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    rotation = q * np.sign(np.linalg.det(q))
    return Transform(rotation, rng.uniform(-reach_mm, reach_mm, 3))


def simulated_run(
    rng: np.random.Generator,
    *,
    seconds: float = 30.0,
    rate_hz: float = 30.0,
    lag_s: float = 0.0,
    drift: float = 0.0,
    jitter_s: float = 0.0,
    tracker_sd_mm: float = 0.02,
    robot_sd_mm: float = 0.01,
) -> SimulatedRun:
    """Simulate one run: minimum-jerk moves about the trocar in the section, with tremor.

    Args:
        rng: Random numbers.
        seconds: Duration.
        rate_hz: Images per second.
        lag_s: How late the robot's stamps are in the middle of the run.
        drift: How much later they become per second.
        jitter_s: Standard deviation of their noise.
        tracker_sd_mm: Of the tips in images, per axis; errors last for some images.
        robot_sd_mm: Of the robot's tips, per axis.
    """
    times_s = np.arange(-6.0, seconds + 6.0, STEP_S)
    depth_mm = _moves(rng, times_s, 4.0, 21.0) + _tremor(rng, times_s, 0.02)
    pitch = np.radians(_moves(rng, times_s, -9.0, 9.0)) + _tremor(rng, times_s, 0.02) / 15.0
    inwards = np.arctan2(-TROCAR_MM[1], -TROCAR_MM[0]) + pitch
    along = np.column_stack((np.cos(inwards), np.sin(inwards), np.zeros(len(times_s))))
    tips_mm = np.append(TROCAR_MM, 0.0) + depth_mm[:, None] * along
    image_s = np.arange(0.0, seconds, 1 / rate_hz)
    image_mm = _at(times_s, tips_mm[:, :2], image_s)
    image_mm += _correlated(rng, len(image_s), np.exp(-1 / (rate_hz * CORRELATION_S)), tracker_sd_mm)
    eye_from_base = random_transform(rng)
    base_from_eye = eye_from_base.inverse()
    stamps_s = times_s + lag_s + drift * (times_s - seconds / 2) + rng.normal(0, jitter_s, len(times_s))
    order = np.argsort(stamps_s, kind="stable")
    return SimulatedRun(
        image_s,
        image_mm,
        stamps_s[order],
        (base_from_eye.point_mm(tips_mm) + rng.normal(0, robot_sd_mm, tips_mm.shape))[order],
        (along @ base_from_eye.rotation.T)[order],
        lag_s,
        eye_from_base,
        base_from_eye.point_mm(np.append(TROCAR_MM, 0.0)),
    )


def led_path(run: SimulatedRun) -> tuple[Floats, Floats]:
    """Return where a hand led the tip, as recorded with each image: times and points, (n,) and (n, 3)."""
    return run.image_s, _at(run.robot_s, run.robot_mm, run.image_s)


def tool_pose(tip_mm: Floats, axis: Floats) -> ToolPose:
    """Return a tool whose z axis runs along its shaft."""
    other = np.cross(axis, np.eye(3)[int(np.argmin(np.abs(axis)))])
    other /= np.linalg.norm(other)
    rotation = np.column_stack((np.cross(other, axis), other, axis))
    x, y, z = tip_mm.tolist()
    return ToolPose((x, y, z), quaternion_of(rotation))


def _moves(rng: np.random.Generator, times_s: Floats, low: float, high: float) -> Floats:
    """Return minimum-jerk moves between random values, of 0.6 to 3 s each."""
    ends = [float(times_s[0])]
    while ends[-1] < times_s[-1]:
        ends.append(ends[-1] + float(rng.uniform(0.6, 3.0)))
    values = rng.uniform(low, high, len(ends))
    number = np.clip(np.searchsorted(ends, times_s, side="right") - 1, 0, len(ends) - 2)
    start, end = np.array(ends)[number], np.array(ends)[number + 1]
    share = (times_s - start) / (end - start)
    smooth = share**3 * (10 - 15 * share + 6 * share**2)
    return values[number] + smooth * (values[number + 1] - values[number])


def _tremor(rng: np.random.Generator, times_s: Floats, rms_mm: float) -> Floats:
    hertz, phase = rng.uniform(*TREMOR_HZ, 12), rng.uniform(0, 2 * np.pi, 12)
    return rms_mm * np.sqrt(2 / 12) * np.sin(2 * np.pi * np.outer(times_s, hertz) + phase).sum(axis=1)


def _correlated(rng: np.random.Generator, count: int, correlation: float, sd_mm: float) -> Floats:
    errors = rng.normal(0, sd_mm, (count, 2))
    fresh = np.sqrt(1 - correlation**2)
    for number in range(1, count):
        errors[number] = correlation * errors[number - 1] + fresh * errors[number]
    return errors


def _at(times_s: Floats, values: Floats, at_s: Floats) -> Floats:
    return np.column_stack([np.interp(at_s, times_s, column) for column in values.T])
