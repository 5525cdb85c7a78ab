"""The lag between two recordings of one motion: tips in images and of a robot -> lag, drift, intervals.

The robot's motion is resampled at the times of the images, moved by a trial lag, and fitted to the motion in the
images by the best isometry of a plane, or affinely if the motion has none; the residual is least at the lag.
Errors resemble each other over time, so the intervals are those of a jackknife that leaves out a tenth of the
run at a time (Künsch 1989, Annals of Statistics 17(3)).
"""

import math

import numpy as np
from msgspec import Struct
from scipy import stats

from haptigraph.errors import BadInput
from haptigraph.robot.autocorrelation import values_per_independent
from haptigraph.robot.pose import Floats

__all__ = ["Lag", "Motion", "estimate_lag"]

WINDOW_S = 5.0
"""The largest lag that is searched for."""
COARSE_S = 0.04
MIN_IMAGES = 60
MIN_OVERLAP = 0.5
MIN_MOTION_MM = 1.0
OUTLIER_SDS = 5.0
MAD_TO_SD = 1.4826
MIN_EXPLAINED = 0.8
MIN_EVIDENCE = 20.0
APART_S = 0.25
ITERATIONS = 8
SLOPE_S = 0.01  # to either side, over which the robot's speed is measured
BLOCKS = 10
WIDE = float(stats.t.ppf(0.975, BLOCKS - 1))
"""Standard deviations of a 95 % interval."""
MAX_INTERVAL_S = 0.2
PLANE = 0.02  # of the largest extent: less than that in the third direction is a plane


class Motion(Struct, frozen=True):
    """Two recordings of one motion."""

    image_s: Floats
    """Times of the images, increasing, (n,)."""
    image_mm: Floats
    """Tips in the images, eye frame, (n, 2)."""
    robot_s: Floats
    """Stamps of the robot's samples, increasing, (m,)."""
    robot_mm: Floats
    """Its tips, in its base, (m, 3)."""


class Lag(Struct, frozen=True):
    """How much later than the images the robot's stamps are."""

    lag_s: float
    """In the middle of the run: a pose stamped t + lag_s is that of an image stamped t."""
    lag_sd_s: float
    interval_s: tuple[float, float]
    """95 %."""
    drift_s_per_s: float
    """How much the lag grows per second."""
    drift_interval_s_per_s: tuple[float, float]
    middle_s: float
    """The time to which `lag_s` refers, on the images' clock."""
    duration_s: float
    images: int
    """How many images were used."""
    explained: float
    """Share of the motion in the images that the robot's motion explains."""
    residual_mm: float
    """RMS per axis, of robust fit."""

    @property
    def is_drift_significant(self) -> bool:
        """Whether the interval of the drift excludes 0."""
        low, high = self.drift_interval_s_per_s
        return low > 0 or high < 0

    @property
    def is_significant(self) -> bool:
        """Whether the interval excludes 0."""
        low, high = self.interval_s
        return low > 0 or high < 0


def estimate_lag(motion: Motion, what: str, window_s: float = WINDOW_S) -> Lag:
    """Estimate the lag of the robot's stamps.

    Args:
        motion: Both recordings.
        what: Names the run in errors.
        window_s: The largest lag that is searched for.

    Raises:
        BadInput: If there is too little motion, no relation between the two, or the lag is ambiguous.
    """
    _check_enough(motion, what)
    coordinates = _coordinates(motion.robot_mm)
    lags = np.arange(-round(window_s / COARSE_S), round(window_s / COARSE_S) + 1) * COARSE_S
    cost = np.array([_mean_square(motion, coordinates, lag) for lag in lags])
    if not np.isfinite(cost).any():
        raise BadInput("images and robot do not overlap in time", what)
    best = int(np.nanargmin(np.where(np.isfinite(cost), cost, np.nan)))
    kept = _inliers(motion, coordinates, float(lags[best]))
    motion = Motion(motion.image_s[kept], motion.image_mm[kept], motion.robot_s, motion.robot_mm)
    cost = np.array([_mean_square(motion, coordinates, lag) for lag in lags])
    best = int(np.nanargmin(np.where(np.isfinite(cost), cost, np.nan)))
    _check_unambiguous(motion, coordinates, lags, cost, best, what)
    return _refined(motion, coordinates, float(lags[best]), window_s, what)


def _check_enough(motion: Motion, what: str) -> None:
    if len(motion.image_s) < MIN_IMAGES or len(motion.robot_s) < MIN_IMAGES:
        found = f"{len(motion.image_s)} images with a tip and {len(motion.robot_s)} robot samples"
        raise BadInput(f"{found} are too few; at least {MIN_IMAGES} of each are needed", what)
    moved_mm = min(_spread_mm(motion.image_mm), _spread_mm(motion.robot_mm))
    if moved_mm < MIN_MOTION_MM:
        raise BadInput(
            f"too little motion to compare: the tip moves by {moved_mm:.2f} mm RMS, at least "
            f"{MIN_MOTION_MM:g} mm is needed",
            what,
        )


def _check_unambiguous(
    motion: Motion, coordinates: Floats, lags: Floats, cost: Floats, best: int, what: str
) -> None:
    total = float(motion.image_mm.var(axis=0).sum())
    if cost[best] > (1 - MIN_EXPLAINED) * total:
        raise BadInput(
            f"the robot's motion explains only {100 * (1 - cost[best] / total):.0f} % of the motion in the "
            "images, at whatever lag; is it the same instrument?",
            what,
        )
    if best in (0, len(lags) - 1):
        raise BadInput(f"the lag is beyond {lags[-1]:g} s, which is as far as is searched", what)
    _, residual, _ = _fitted(motion, coordinates, float(lags[best]))
    independent = residual.size / values_per_independent(residual)
    elsewhere = np.where(np.abs(lags - lags[best]) > APART_S, cost, np.inf)
    other = int(np.nanargmin(np.where(np.isfinite(elsewhere), elsewhere, np.inf)))
    if independent * math.log(elsewhere[other] / cost[best]) < MIN_EVIDENCE:
        raise BadInput(
            f"the lag is ambiguous: the motion repeats itself, and fits at {lags[best]:.2f} s and at "
            f"{lags[other]:.2f} s",
            what,
        )


def _refined(motion: Motion, coordinates: Floats, lag_s: float, window_s: float, what: str) -> Lag:
    """Estimate lag, drift and map together by Gauss-Newton, from a lag that is nearly right."""
    middle_s = float(motion.image_s.mean())
    drift, since_s = 0.0, motion.image_s - middle_s
    for _ in range(ITERATIONS):
        inside, residual, columns = _fitted(motion, coordinates, lag_s, drift, middle_s)
        (step_s, step), _ = _solved(residual, columns, since_s[inside])
        lag_s += float(np.clip(step_s, -COARSE_S, COARSE_S))
        drift += float(np.clip(step, -1e-2, 1e-2))
    inside, residual, columns = _fitted(motion, coordinates, lag_s, drift, middle_s)
    _, sds = _solved(residual, columns, since_s[inside])
    duration_s = float(np.ptp(motion.image_s))
    if WIDE * sds[0] > MAX_INTERVAL_S or abs(lag_s) > window_s + COARSE_S:
        half_ms = 1e3 * WIDE * sds[0]
        raise BadInput(f"too little motion to tell the lag: the interval would be ± {half_ms:.0f} ms", what)
    total = motion.image_mm[inside].var(axis=0).sum()
    mean_square = float((residual**2).sum(axis=1).mean())
    return Lag(
        lag_s,
        float(sds[0]),
        (lag_s - WIDE * float(sds[0]), lag_s + WIDE * float(sds[0])),
        drift,
        (drift - WIDE * float(sds[1]), drift + WIDE * float(sds[1])),
        middle_s,
        duration_s,
        int(inside.sum()),
        float(1 - mean_square / total),
        math.sqrt(mean_square / 2),
    )


def _solved(residual: Floats, columns: tuple[Floats, Floats], since_s: Floats) -> tuple[Floats, Floats]:
    """Return steps of lag and drift, and their standard deviations.

    Args:
        residual: (n, 2).
        columns: Derivatives of the map's parameters (2 n, p), and the speed (n, 2).
        since_s: Times from the middle of the run, (n,).
    """
    nuisance, speed = columns
    wanted = np.stack((speed, speed * since_s[:, None]), axis=-1).reshape(-1, 2)
    design, flat = np.hstack((wanted, nuisance)), residual.reshape(-1)
    parts = np.array_split(np.arange(len(flat)), BLOCKS)
    grams = np.array([design[part].T @ design[part] for part in parts])
    sums = np.array([design[part].T @ flat[part] for part in parts])
    ridge = 1e-12 * np.trace(grams.sum(axis=0)) * np.eye(design.shape[1])
    step = np.linalg.solve(grams.sum(axis=0) + ridge, sums.sum(axis=0))[:2]
    without = [
        np.linalg.solve(grams.sum(axis=0) - gram + ridge, sums.sum(axis=0) - each)[:2]
        for gram, each in zip(grams, sums, strict=True)
    ]
    spread = np.square(np.array(without) - np.mean(without, axis=0)).sum(axis=0)
    return step, np.sqrt((BLOCKS - 1) / BLOCKS * spread)


def _fitted(
    motion: Motion, coordinates: Floats, lag_s: float, drift: float = 0.0, middle_s: float = 0.0
) -> tuple[Floats, Floats, tuple[Floats, Floats]]:
    """Return which images are covered, their residuals, and the derivatives of the fit."""
    at_s = motion.image_s + lag_s + drift * (motion.image_s - middle_s)
    inside = (at_s >= motion.robot_s[0]) & (at_s <= motion.robot_s[-1])
    at_s, image_mm = at_s[inside], motion.image_mm[inside]
    there = _at(motion.robot_s, coordinates, at_s)
    ahead, behind = (_at(motion.robot_s, coordinates, at_s + s) for s in (SLOPE_S, -SLOPE_S))
    centred, target = there - there.mean(axis=0), image_mm - image_mm.mean(axis=0)
    linear = _map(centred, target)
    residual = target - centred @ linear.T
    return inside, residual, (_nuisance(centred, linear), (ahead - behind) / (2 * SLOPE_S) @ linear.T)


def _map(centred: Floats, target: Floats) -> Floats:
    """Return the best map of the robot's coordinates to the section: an isometry of a plane, else affine."""
    if centred.shape[1] == 2:
        u, _, vt = np.linalg.svd(target.T @ centred)
        isometry: Floats = u @ vt
        return isometry
    affine: Floats = np.linalg.lstsq(centred, target, rcond=None)[0].T
    return affine


def _nuisance(centred: Floats, linear: Floats) -> Floats:
    """Return how the fitted tips change with the parameters of the map, (2 n, p)."""
    count = len(centred)
    shifts = np.tile(np.eye(2), (count, 1))
    if centred.shape[1] == 2:
        moved = centred @ linear.T
        turn = np.column_stack((-moved[:, 1], moved[:, 0])).reshape(-1, 1)
        return np.hstack((shifts, turn))
    return np.hstack((shifts, np.kron(centred, np.eye(2))))


def _mean_square(motion: Motion, coordinates: Floats, lag_s: float) -> float:
    """Return the mean squared residual at a lag; infinite if too few images are covered."""
    at_s = motion.image_s + lag_s
    inside = (at_s >= motion.robot_s[0]) & (at_s <= motion.robot_s[-1])
    if inside.sum() < MIN_OVERLAP * len(at_s):
        return math.inf
    there, target = _at(motion.robot_s, coordinates, at_s[inside]), motion.image_mm[inside]
    centred, target = there - there.mean(axis=0), target - target.mean(axis=0)
    residual = target - centred @ _map(centred, target).T
    return float((residual**2).sum(axis=1).mean())


def _inliers(motion: Motion, coordinates: Floats, lag_s: float) -> Floats:
    inside, residual, _ = _fitted(motion, coordinates, lag_s)
    distance = np.linalg.norm(residual, axis=1)
    limit = OUTLIER_SDS * MAD_TO_SD * float(np.median(distance))
    kept = inside.copy()
    kept[inside] = distance <= limit
    return kept


def _coordinates(robot_mm: Floats) -> Floats:
    """Return the robot's tips in the plane of their motion, (m, 2), or in space, if there is none, (m, 3)."""
    centred = robot_mm - robot_mm.mean(axis=0)
    _, extents, vt = np.linalg.svd(centred, full_matrices=False)
    axes = 2 if extents[2] < PLANE * extents[0] else 3
    coordinates: Floats = centred @ vt[:axes].T
    return coordinates


def _at(times_s: Floats, values: Floats, at_s: Floats) -> Floats:
    return np.column_stack([np.interp(at_s, times_s, column) for column in values.T])


def _spread_mm(points_mm: Floats) -> float:
    return math.sqrt(float(points_mm.var(axis=0).sum()))
