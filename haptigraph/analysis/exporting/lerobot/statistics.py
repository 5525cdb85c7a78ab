"""Statistics of a feature over an episode and over all: what LeRobot normalises by.

Unknown values (NaN) are left out. Quantiles over all episodes are means of theirs, weighted by their number
of values, as in LeRobot itself.
"""

from collections.abc import Mapping, Sequence
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

__all__ = ["ImageStatistics", "Statistics", "of_values", "over_all"]

Numbers: TypeAlias = NDArray[np.float64]
Statistics: TypeAlias = dict[str, Numbers]
"""By name: min, max, mean, std and quantiles of every channel; count, (1,), the number of rows."""
QUANTILES = {"q01": 0.01, "q10": 0.1, "q50": 0.5, "q90": 0.9, "q99": 0.99}
PIXEL_STEP = 4
"""Of an image, every fourth pixel of every fourth row counts."""


def of_values(values: Numbers) -> tuple[Statistics, Numbers]:
    """Return the statistics of an episode, and the number of known values of every channel.

    Args:
        values: (rows, channels); NaN where unknown. Statistics of an unknown channel are NaN.
    """
    known = np.sum(~np.isnan(values), axis=0).astype(np.float64)
    some = known > 0
    empty = np.full(values.shape[1], np.nan)
    statistics = {name: empty.copy() for name in ("min", "max", "mean", "std", *QUANTILES)}
    if some.any():
        seen = values[:, some]
        statistics["min"][some], statistics["max"][some] = np.nanmin(seen, 0), np.nanmax(seen, 0)
        statistics["mean"][some], statistics["std"][some] = np.nanmean(seen, 0), np.nanstd(seen, 0)
        for name, share in QUANTILES.items():
            statistics[name][some] = np.nanquantile(seen, share, axis=0)
    return statistics | {"count": np.array([float(len(values))])}, known


class ImageStatistics:
    """Collect the statistics of the images of an episode, in [0, 1], from a histogram of their pixels."""

    def __init__(self) -> None:
        self._histogram = np.zeros((3, 256))
        self._count = 0

    def add(self, picture: NDArray[np.uint8]) -> None:
        """Count an image, (height, width, 3) RGB."""
        pixels = picture[::PIXEL_STEP, ::PIXEL_STEP].reshape(-1, 3)
        self._histogram += [np.bincount(channel, minlength=256) for channel in pixels.T]
        self._count += 1

    def result(self) -> tuple[Statistics, Numbers]:
        """Return what `of_values` does, of shape (3, 1, 1); NaN without an image."""
        values, weights = np.arange(256) / 255, self._histogram
        channels = [_of_histogram(values, each) for each in weights]
        statistics = {
            name: np.array([channel[name] for channel in channels]).reshape(3, 1, 1) for name in channels[0]
        }
        known = np.full((3, 1, 1), float(self._count))
        return statistics | {"count": np.array([float(self._count)])}, known


def _of_histogram(values: Numbers, weights: Numbers) -> dict[str, float]:
    total = weights.sum()
    if not total:
        return dict.fromkeys(("min", "max", "mean", "std", *QUANTILES), float("nan"))
    mean = float(values @ weights / total)
    below = np.cumsum(weights) / total
    return {
        "min": float(values[weights > 0][0]),
        "max": float(values[weights > 0][-1]),
        "mean": mean,
        "std": float(np.sqrt((values - mean) ** 2 @ weights / total)),
        **{name: float(values[np.searchsorted(below, share)]) for name, share in QUANTILES.items()},
    }


def over_all(episodes: Sequence[tuple[Mapping[str, Numbers], Numbers]]) -> Statistics:
    """Return the statistics of a feature over all episodes.

    Args:
        episodes: Its statistics and its number of known values in each.
    """
    known = np.stack([count for _, count in episodes])
    each = {name: np.stack([one[name] for one, _ in episodes]) for name in episodes[0][0]}
    with np.errstate(invalid="ignore"):
        total = known.sum(0)

        def mean(values: Numbers) -> Numbers:
            weighted: Numbers = np.where(known > 0, values * known, 0.0).sum(0) / total
            return weighted

        center = mean(each["mean"])
        variance = mean(each["std"] ** 2 + (each["mean"] - center) ** 2)
        quantiles = {name: mean(each[name]) for name in QUANTILES}
    lowest = np.where(known > 0, each["min"], np.inf).min(0)
    highest = np.where(known > 0, each["max"], -np.inf).max(0)
    return {
        "min": lowest,
        "max": highest,
        "mean": center,
        "std": np.sqrt(variance),
        "count": each["count"].sum(0),
        **quantiles,
    }
