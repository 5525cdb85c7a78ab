"""The map from poses measured in volumes to labelled ones: quadratic, with and without drift over time.

The coefficients of the quadratic terms have normal priors, and the drift is a Wiener process on a clock of
its own (`drift_clock`). The priors' variances have the greatest restricted likelihood (Patterson, Thompson,
Biometrika 58, 1971). Standard deviations are scaled so that cross-validated residuals of the calibrations
have the normal distribution's share within one and two of them.
"""

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from haptigraph.analysis.evaluation.drift_clock import DriftClock, estimate_clock
from haptigraph.perception.instrument.rotations import Array

__all__ = ["Prediction", "QuadraticMap", "fit_offset_mm"]

MAX_FOR_VARIANCES = 300
"""Evenly spaced ones of more are used where only variances are estimated."""
MAX_CALIBRATIONS = 1500
"""Evenly spaced ones of more are used at all: the time grows with the cube."""
LINEAR, POSITION, MIXED, ROTATION = range(4)
"""Groups of features: constant and linear; products of positions, of both kinds, of rotations."""
DRIFT = 3
"""Index of the drift's variance among the logarithms of variances; the others are of groups."""
START = np.array([-3.0, -5.0, -5.0, 1.0])
LOWEST = -10.0
HIGHEST = np.array([2.0, 2.0, 2.0, 3.0])
"""A drift that may vary faster would take up the noise where it has steps; then it gets a clock."""
FIRST_STEP, NEAR_STEP, LAST_STEP = 2.0, 0.5, 0.25
OUTLIER_SDS = 6.0
"""A calibration further off its leave-one-out prediction is left out."""
MIN_KEPT = 0.9
"""Share of the calibrations that must remain."""
ONE_SD, TWO_SDS = 68.27, 95.45
"""Percent of normal errors that lie within."""
FOLDS = 5
"""Of the cross-validation."""
SCALES = (0.5, 3.0)


class Prediction(Struct, frozen=True, eq=False):
    """Predicted values of one component of the labels."""

    values: Array
    sds: Array


class _Solution(Struct, frozen=True, eq=False):
    """Generalised least squares for given variances, as shares of that of the noise."""

    inverse: Array
    """Of the covariance, (n, n)."""
    projected: Array
    """The inverse, less what the linear features explain, (n, n)."""
    coefficients: Array
    weighted: Array
    """Inverse times residual, (n,)."""
    noise: float
    """Variance of the noise."""
    log_likelihood: float


class QuadraticMap:
    """The map to one component of the labels, fitted to calibrations.

    Args:
        measured: Position and rotation vector of calibrations, (n, 6).
        hours: When they were measured, since the first volume of all, (n,).
        labels: The component, (n,).
        has_drift: Whether it may drift over time.
    """

    def __init__(self, measured: Array, hours: Array, labels: Array, *, has_drift: bool) -> None:
        some = _evenly(len(labels), MAX_CALIBRATIONS)
        measured, hours, labels = measured[some], hours[some], labels[some]
        self._fit = _Fit(measured, hours, labels, has_drift=has_drift)
        z = []
        for fold in range(FOLDS):
            is_left_out = np.arange(len(labels)) % FOLDS == fold
            used = ~is_left_out
            fit = _Fit(
                *(measured[used], hours[used], labels[used]), has_drift=has_drift, near=self._fit.first_logs
            )
            predicted = fit.predict(measured[is_left_out], hours[is_left_out])
            z.append(np.abs(labels[is_left_out] - predicted.values) / predicted.sds)
        one, two = np.percentile(np.concatenate(z), (ONE_SD, TWO_SDS))
        self._scale = float(np.clip(np.sqrt(one * two / 2), *SCALES))

    def predict(self, measured: Array, hours: Array) -> Prediction:
        """Predict the label's component of other measurements."""
        predicted = self._fit.predict(measured, hours)
        return Prediction(predicted.values, self._scale * predicted.sds)


class _Fit:
    """A fit whose standard deviations are those of its model; see `QuadraticMap`.

    Args:
        measured: See `QuadraticMap`.
        hours: See `QuadraticMap`.
        labels: See `QuadraticMap`.
        has_drift: See `QuadraticMap`.
        near: Logarithms of variances of a similar fit, if any.
    """

    def __init__(
        self, measured: Array, hours: Array, labels: Array, *, has_drift: bool, near: Array | None = None
    ) -> None:
        self._mean, self._spread = measured.mean(axis=0), measured.std(axis=0) + 1e-12
        self._has_drift = has_drift
        self._clock: DriftClock | None = None
        features = self._features(measured)
        some = _evenly(len(labels), MAX_FOR_VARIANCES)
        self.first_logs = self._most_likely(features[some], hours[some], labels[some], near)
        """Logarithms of variances, as shares of the noise's, before there was a clock."""
        self._logs = self.first_logs.copy()
        solution = self._solve(features, hours, labels, self._logs)
        if has_drift:
            self._clock = estimate_clock(hours, labels - self._still(features, solution))
            self._logs[DRIFT] = 0.0  # the clock reads variances
            solution = self._solve(features, self._times(hours), labels, self._logs)
        errors, sds = _left_out(solution, labels)
        kept = np.abs(errors) <= OUTLIER_SDS * sds
        if MIN_KEPT <= kept.mean() < 1:
            features, hours, labels = features[kept], hours[kept], labels[kept]
            solution = self._solve(features, self._times(hours), labels, self._logs)
        self._calibration, self._solution = (features, self._times(hours)), solution

    def _times(self, hours: Array) -> Array:
        return hours if self._clock is None else self._clock.at(hours)

    def predict(self, measured: Array, hours: Array) -> Prediction:
        """Predict the label's component of other measurements."""
        features, (calibrated, then) = self._features(measured), self._calibration
        now = self._times(hours)
        solution = self._solution
        shared = self._covariance(features, now, calibrated, then, self._logs)
        linear = _group(features, LINEAR)
        values = linear @ solution.coefficients + shared @ solution.weighted
        through = shared @ solution.inverse
        known = _group(calibrated, LINEAR)
        unexplained = linear - through @ known
        information = known.T @ solution.inverse @ known
        prior = self._own_variance(features, now)
        variance = 1 + prior - np.sum(through * shared, axis=1)
        variance += np.sum(unexplained * np.linalg.solve(information, unexplained.T).T, axis=1)
        return Prediction(values, np.sqrt(solution.noise * np.maximum(variance, 1e-6)))

    def _still(self, features: Array, solution: _Solution) -> Array:
        """Return what the map predicts without drift, (n,)."""
        quadratic = np.zeros(len(features))
        for k, group in enumerate((POSITION, MIXED, ROTATION)):
            part = _group(features, group)
            quadratic += np.exp(self._logs[k]) * (part @ (part.T @ solution.weighted))
        return _group(features, LINEAR) @ solution.coefficients + quadratic

    def _most_likely(self, features: Array, times: Array, labels: Array, near: Array | None) -> Array:
        """Return the logarithms of the variances, by a pattern search."""
        logs = START.copy() if near is None else near.copy()
        free = range(DRIFT + 1 if self._has_drift else DRIFT)
        best = self._solve(features, times, labels, logs).log_likelihood
        step = FIRST_STEP if near is None else NEAR_STEP
        while step >= LAST_STEP:
            improved = False
            for k in free:
                for sign in (1, -1):
                    tried = logs.copy()
                    tried[k] = np.clip(tried[k] + sign * step, LOWEST, HIGHEST[k])
                    score = self._solve(features, times, labels, tried).log_likelihood
                    if score > best + 1e-6:
                        logs, best, improved = tried, score, True
                        break
            if not improved:
                step /= 2
        return logs

    def _solve(self, features: Array, times: Array, labels: Array, logs: Array) -> _Solution:
        covariance = self._covariance(features, times, features, times, logs)
        covariance[np.diag_indices_from(covariance)] += 1.0
        factor = np.linalg.cholesky(covariance)
        inverse = np.linalg.inv(covariance)
        linear = _group(features, LINEAR)
        whitened = inverse @ linear
        information = linear.T @ whitened
        projected = inverse - whitened @ np.linalg.solve(information, whitened.T)
        coefficients = np.linalg.solve(information, whitened.T @ labels)
        degrees = len(labels) - linear.shape[1]
        noise = max(float(labels @ projected @ labels) / degrees, 1e-18)
        log_determinants = 2 * np.log(factor.diagonal()).sum() + np.linalg.slogdet(information)[1]
        log_likelihood = -0.5 * (degrees * np.log(noise) + log_determinants)
        weighted = inverse @ (labels - linear @ coefficients)
        return _Solution(inverse, projected, coefficients, weighted, noise, float(log_likelihood))

    def _covariance(self, a: Array, times_a: Array, b: Array, times_b: Array, logs: Array) -> Array:
        covariance = np.zeros((len(a), len(b)))
        for k, group in enumerate((POSITION, MIXED, ROTATION)):
            covariance += np.exp(logs[k]) * (_group(a, group) @ _group(b, group).T)
        if self._has_drift:
            covariance += np.exp(logs[DRIFT]) * np.minimum(times_a[:, None], times_b[None])
        return covariance

    def _own_variance(self, features: Array, times: Array) -> Array:
        own = sum(
            np.exp(self._logs[k]) * np.sum(_group(features, group) ** 2, axis=1)
            for k, group in enumerate((POSITION, MIXED, ROTATION))
        )
        return np.asarray(own + np.exp(self._logs[DRIFT]) * times * self._has_drift)

    def _features(self, measured: Array) -> Array:
        scaled = (measured - self._mean) / self._spread
        products = [scaled[:, i] * scaled[:, j] for i, j in _PAIRS]
        return np.column_stack([np.ones(len(scaled)), scaled, *products])


_PAIRS = [(i, j) for i in range(6) for j in range(i, 6)]
_GROUPS: NDArray[np.int_] = np.array([LINEAR] * 7 + [POSITION + (i > 2) + (j > 2) for i, j in _PAIRS])


def fit_offset_mm(tips_mm: Array, positions_mm: Array, rotations: Array) -> Array:
    """Return where the tip is in the frame of what is labelled (a hexapod's platform), (3,).

    Least squares over the offset and a quadratic map from measured tips to labelled ones.

    Args:
        tips_mm: Measured, (n, 3).
        positions_mm: Labelled, (n, 3).
        rotations: Labelled, (n, 3, 3).
    """
    scaled = (tips_mm - tips_mm.mean(axis=0)) / (tips_mm.std(axis=0) + 1e-12)
    quadratic = np.column_stack(
        [np.ones(len(scaled)), scaled, *(scaled[:, i] * scaled[:, j] for i, j in _PAIRS if j < 3)]
    )
    terms = quadratic.shape[1]
    system = np.zeros((3 * len(scaled), 3 * terms + 3))
    for k in range(3):
        system[k::3, k * terms : (k + 1) * terms] = quadratic
    system[:, 3 * terms :] = -rotations.reshape(-1, 3)
    solution = np.linalg.lstsq(system, positions_mm.ravel(), rcond=1e-10)[0]
    offset: Array = solution[3 * terms :]
    return offset


def _group(features: Array, group: int) -> Array:
    return features[:, group == _GROUPS]


def _left_out(solution: _Solution, labels: Array) -> tuple[Array, Array]:
    """Return the leave-one-out residuals and their standard deviations."""
    precision = solution.projected.diagonal()
    return solution.projected @ labels / precision, np.sqrt(solution.noise / precision)


def _evenly(count: int, most: int) -> NDArray[np.int_]:
    return np.linspace(0, count - 1, min(count, most)).round().astype(int)
