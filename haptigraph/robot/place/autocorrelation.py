"""How many of the values of a series are worth one independent value, as their errors resemble each other."""

from haptigraph.robot.pose import Floats

__all__ = ["values_per_independent"]


def values_per_independent(residuals: Floats) -> float:
    """Return the integrated autocorrelation time of residuals, in values; at least 1.

    Correlations are summed until their pairs turn negative (Geyer 1992, Statistical Science 7(4)).

    Args:
        residuals: In the order of time, (n,) or (n, columns), of which the most correlated column counts.
    """
    if residuals.ndim == 2:
        return max(values_per_independent(column) for column in residuals.T)
    series = residuals
    series = series - series.mean()
    variance = float(series @ series)
    if variance <= 0.0 or len(series) < 4:
        return 1.0
    total, lag = 1.0, 1
    while lag + 1 < len(series) // 2:
        pair = sum(float(series[k:] @ series[:-k]) for k in (lag, lag + 1)) / variance
        if pair <= 0.0:
            break
        total += 2 * pair
        lag += 2
    return max(total, 1.0)
