"""A robust straight line through values of one known standard deviation, with outliers and few samples."""

import numpy as np
from msgspec import Struct

from haptigraph.imaging import Floats, Mask

__all__ = ["MIN_SAMPLES", "Fit", "robust_line"]

OUTLIER_SD = 4.0
MIN_SAMPLES = 4
MIN_INLIER_SHARE = 0.35
PRIOR_SAMPLES = 8.0  # the weight of the given standard deviation against the scatter about the line
ALIKE_SAMPLES = 2.0  # neighbours that err alike: the matching window is longer than a block
MAX_LEVERAGE = 0.8  # of a sample on the line: beyond, the others could not show that it is an outlier
MAX_SCATTER = 6.0  # mean squared residual over the given variance: beyond, it is no line


class Fit(Struct, frozen=True, eq=False):
    """The line value = offset + slope * at."""

    answer: Floats
    """Offset and slope, (2,)."""
    covariance: Floats
    """(2, 2), with the given systematic errors."""

    def __call__(self, at: float) -> float:
        """Return the value at a position."""
        return float(self.answer[0] + self.answer[1] * at)


def robust_line(at: Floats, values: Floats, sd: float, systematic: Floats) -> Fit | None:
    """Fit a line to most of some samples.

    The line through two of them that most others are near selects the samples; generalized least squares fits
    a line to them, with the errors that they share. Their scatter about it corrects the given standard
    deviation as far as there are enough of them.

    Args:
        at: Positions, (n,).
        values: (n,).
        sd: Standard deviation of a value.
        systematic: Change of the values by one standard deviation of each error that they share, (k, n).

    Returns:
        The line; None if there are too few samples, they are on no line, or one of them alone decides it.
    """
    if len(at) < MIN_SAMPLES:
        return None
    is_inlier = _consensus(at, values, OUTLIER_SD * sd)
    count = int(is_inlier.sum())
    if count < max(MIN_SAMPLES, MIN_INLIER_SHARE * len(at)):
        return None
    design = np.column_stack([np.ones(count), at[is_inlier]])
    chosen, shared = values[is_inlier], systematic[:, is_inlier]
    hat = design @ np.linalg.pinv(design)
    squares = float((((chosen - hat @ chosen) / sd) ** 2).sum())
    if squares > MAX_SCATTER * (count - 2) or np.diag(hat).max() > MAX_LEVERAGE:
        return None
    variance = sd**2 * (PRIOR_SAMPLES + squares) / (PRIOR_SAMPLES + count - 2)
    weights = np.linalg.inv(ALIKE_SAMPLES * variance * np.eye(count) + shared.T @ shared)
    covariance = np.linalg.inv(design.T @ weights @ design)
    return Fit(covariance @ design.T @ weights @ chosen, covariance)


def _consensus(at: Floats, values: Floats, within: float) -> Mask:
    """Return the samples near that line through two of them which most are near."""
    first, second = np.triu_indices(len(at), 1)
    slopes = (values[second] - values[first]) / (at[second] - at[first])
    off = np.abs(values - values[first, None] - slopes[:, None] * (at - at[first, None]))
    scores = np.minimum(off / within, 1.0).sum(axis=1)
    return np.asarray(off[scores.argmin()] <= within, np.bool_)
