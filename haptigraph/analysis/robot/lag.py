"""The lag between two recordings of a motion: tips in images, of a robot or hand -> lag, drift, intervals.

The robot's motion is resampled at the times of the images, moved by a trial lag, and fitted to the motion in
the images by the best isometry of a plane, or affinely if the motion has none; the residual is least at the
lag. Errors resemble each other over time, so the intervals are those of a jackknife that leaves out a tenth
of the run at a time (Künsch 1989, Annals of Statistics 17(3)).
"""

import math
from collections.abc import Sequence

import numpy as np
from msgspec import Struct

from haptigraph.errors import BadInput, MissingExtra
from haptigraph.robot.place.autocorrelation import values_per_independent
from haptigraph.robot.pose import Floats, at_times

try:
    from scipy import stats
except ImportError:
    raise MissingExtra("comparing clocks", "analysis") from None

__all__ = ["Lag", "Motion", "estimate_lag", "median_interval"]

WINDOW_S = 5.0
"""The largest lag that is searched for."""
COARSE_S = 0.04
FINE_S = 0.004
CANDIDATES = 8
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
CONFIDENCE = 0.95
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
    explained_share: float
    """Share of the motion in the images that the robot's motion explains."""
    residual_mm: float
    """RMS per axis, of robust fit."""

    @property
    def is_drift_significant(self) -> bool:
        """Whether the interval of the drift excludes 0."""
        low, high = self.drift_interval_s_per_s
        return low > 0 or high < 0


def estimate_lag(motion: Motion, what: str, window_s: float = WINDOW_S, mover: str = "robot") -> Lag:
    """Estimate the lag of the robot's stamps.

    Args:
        motion: Both recordings.
        what: Names the run in errors.
        window_s: The largest lag that is searched for.
        mover: Names what moves besides the tip in errors.

    Raises:
        BadInput: If there is too little motion, no relation between the two, or the lag is ambiguous.
    """
    _check_enough(motion, what, mover)
    coordinates = _coordinates(motion.robot_mm)
    minima = _minima(motion, coordinates, window_s)
    if not minima:
        raise BadInput(f"images and {mover} do not overlap in time", what)
    kept = _inliers(motion, coordinates, minima[0][1])
    motion = Motion(motion.image_s[kept], motion.image_mm[kept], motion.robot_s, motion.robot_mm)
    minima = _minima(motion, coordinates, window_s)
    _check_unambiguous(motion, coordinates, minima, window_s, what, mover)
    return _refined(motion, coordinates, minima[0][1], window_s, what)


def _minima(motion: Motion, coordinates: Floats, window_s: float) -> list[tuple[float, float]]:
    """Return the least mean squared residuals and their lags, least first; the border counts as well."""
    steps = round(window_s / COARSE_S)
    lags = np.arange(-steps, steps + 1) * COARSE_S
    cost = np.array([_mean_square(motion, coordinates, lag) for lag in lags])
    around = np.pad(cost, 1, constant_values=math.inf)
    is_least = np.isfinite(cost) & (cost <= around[:-2]) & (cost <= around[2:])
    nearly = sorted(zip(cost[is_least].tolist(), lags[is_least].tolist(), strict=True))[:CANDIDATES]
    fine = np.arange(-COARSE_S, COARSE_S, FINE_S)
    return sorted(
        min((_mean_square(motion, coordinates, lag + step), lag + step) for step in fine.tolist())
        for _, lag in nearly
    )


def _check_enough(motion: Motion, what: str, mover: str) -> None:
    if len(motion.image_s) < MIN_IMAGES or len(motion.robot_s) < MIN_IMAGES:
        found = f"{len(motion.image_s)} images with a tip and {len(motion.robot_s)} {mover} samples"
        raise BadInput(f"{found} are too few; at least {MIN_IMAGES} of each are needed", what)
    moved_mm = min(_spread_mm(motion.image_mm), _spread_mm(motion.robot_mm))
    if moved_mm < MIN_MOTION_MM:
        raise BadInput(
            f"too little motion to compare: the tip moves by {moved_mm:.2f} mm RMS, at least "
            f"{MIN_MOTION_MM:g} mm is needed",
            what,
        )


def _check_unambiguous(
    motion: Motion,
    coordinates: Floats,
    minima: list[tuple[float, float]],
    window_s: float,
    what: str,
    mover: str,
) -> None:
    total = float(motion.image_mm.var(axis=0).sum())
    cost, best_s = minima[0]
    if cost > (1 - MIN_EXPLAINED) * total:
        raise BadInput(
            f"the {mover}'s motion explains only {100 * (1 - cost / total):.0f} % of that in the images, "
            "at whatever lag; is it the same instrument?",
            what,
        )
    _, residual, _ = _fitted(motion, coordinates, best_s)
    independent = residual.size / values_per_independent(residual)
    for other_cost, other_s in minima[1:]:
        evidence = independent * math.log(other_cost / cost)
        if abs(other_s - best_s) > APART_S and evidence < MIN_EVIDENCE:
            raise BadInput(
                f"the lag is ambiguous: the motion repeats itself, and fits at {best_s:.2f} s and at "
                f"{other_s:.2f} s",
                what,
            )
    if abs(best_s) > window_s - COARSE_S:
        raise BadInput(f"the lag is beyond {window_s:g} s, which is as far as is searched", what)


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
    _, half = _solved(residual, columns, since_s[inside])
    if half[0] > MAX_INTERVAL_S or abs(lag_s) > window_s + COARSE_S:
        half_ms = 1e3 * float(half[0])
        raise BadInput(f"too little motion to tell the lag: the interval would be ± {half_ms:.0f} ms", what)
    total = motion.image_mm[inside].var(axis=0).sum()
    mean_square = float((residual**2).sum(axis=1).mean())
    return Lag(
        lag_s,
        (lag_s - float(half[0]), lag_s + float(half[0])),
        drift,
        (drift - float(half[1]), drift + float(half[1])),
        middle_s,
        float(np.ptp(motion.image_s)),
        int(inside.sum()),
        float(1 - mean_square / total),
        math.sqrt(mean_square / 2),
    )


def _solved(residual: Floats, columns: tuple[Floats, Floats], since_s: Floats) -> tuple[Floats, Floats]:
    """Return steps of lag and drift, and the half widths of their 95 % intervals.

    Where few parts of a run hold most of what is known, the interval is as wide as for so few parts (Carter,
    Schnepel and Steigerwald 2017, Rev. Econ. Stat. 99(4)).

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
    information = np.diagonal(grams, axis1=1, axis2=2)[:, :2]
    parts_worth = information.sum(axis=0) ** 2 / (information**2).sum(axis=0)
    wide = stats.t.ppf((1 + CONFIDENCE) / 2, np.maximum(parts_worth - 1, 1.0))
    return step, wide * np.sqrt((BLOCKS - 1) / BLOCKS * spread)


def _fitted(
    motion: Motion, coordinates: Floats, lag_s: float, drift: float = 0.0, middle_s: float = 0.0
) -> tuple[Floats, Floats, tuple[Floats, Floats]]:
    """Return which images are covered, their residuals, and the derivatives of the fit."""
    at_s = motion.image_s + lag_s + drift * (motion.image_s - middle_s)
    inside = (at_s >= motion.robot_s[0]) & (at_s <= motion.robot_s[-1])
    at_s, image_mm = at_s[inside], motion.image_mm[inside]
    there = at_times(motion.robot_s, coordinates, at_s)
    ahead, behind = (at_times(motion.robot_s, coordinates, at_s + s) for s in (SLOPE_S, -SLOPE_S))
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
    affine: Floats = np.linalg.lstsq(centred, target, rcond=None)[0].T.astype(np.float64)
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
    there, target = at_times(motion.robot_s, coordinates, at_s[inside]), motion.image_mm[inside]
    centred, target = there - there.mean(axis=0), target - target.mean(axis=0)
    residual = target - centred @ _map(centred, target).T
    return float((residual**2).sum(axis=1).mean())


def _inliers(motion: Motion, coordinates: Floats, lag_s: float) -> Floats:
    inside, residual, _ = _fitted(motion, coordinates, lag_s)
    distance = np.linalg.norm(residual, axis=1)
    limit = OUTLIER_SDS * MAD_TO_SD * float(np.median(distance))
    kept = np.array(inside)
    kept[inside] = distance <= limit
    return kept


def _coordinates(robot_mm: Floats) -> Floats:
    """Return the robot's tips in the plane of their motion, (m, 2), or in space, if there is none, (m, 3)."""
    centred = robot_mm - robot_mm.mean(axis=0)
    _, extents, vt = np.linalg.svd(centred, full_matrices=False)
    axes = 2 if extents[2] < PLANE * extents[0] else 3
    coordinates: Floats = centred @ vt[:axes].T
    return coordinates


def median_interval(ordered: Sequence[float]) -> tuple[float, float]:
    """Return an interval of the median of ascending values, whatever their distribution: at least 95 %."""
    count = len(ordered)
    below = int(stats.binom.ppf((1 - CONFIDENCE) / 2, count, 0.5))
    return ordered[max(below - 1, 0)], ordered[min(count - below, count - 1)]


def _spread_mm(points_mm: Floats) -> float:
    return math.sqrt(float(points_mm.var(axis=0).sum()))
