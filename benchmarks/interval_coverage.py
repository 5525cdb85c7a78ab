"""Coverage of the intervals of a study report, by simulation: `make interval-coverage`.

Every 95 % interval is that of the report itself, except two that the report leaves out: that of the t test,
and, for rounded values, the differences that the exact test over mid-ranks does not reject. The true value is
that of the population, which the statistic approaches as the number of participants grows: matched-pairs
rank-biserial correlation or Cliff's delta; pseudomedian or median difference; mean difference. Populations
are shifted until the correlation is 0, 0.5 or 0.8. Data without an interval do not count; the last column
states their share.
"""

import argparse
import math
from collections.abc import Callable
from functools import cache, partial
from pathlib import Path

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray
from scipy import stats
from touch_comparison import renew

from haptigraph.analysis.study.statistics.effects import (
    matched_rank_biserial,
    paired_effect,
    rank_biserial,
    unpaired_effect,
)
from haptigraph.analysis.study.statistics.rank_tests import rank_sum, signed_rank
from haptigraph.analysis.study.statistics.shift import paired_shift, unpaired_shift

Floats = NDArray[np.float64]
Draw = Callable[[np.random.Generator, tuple[int, ...]], Floats]
SIZES, EFFECTS = (6, 10, 16), (0.0, 0.5, 0.8)
LOG_SD = 0.6
RATING_SD = 1.5
LARGE = 100_000


class Population(Struct, frozen=True):
    """A distribution of differences (paired), or of observations; tied values are rounded after the shift."""

    name: str
    draw: Draw
    second: Draw
    """Of the second sample, unpaired."""
    is_rounded: bool = False


def _normal(rng: np.random.Generator, shape: tuple[int, ...], sd: float = 1.0) -> Floats:
    return rng.normal(0, sd, shape)


def _log_normal(rng: np.random.Generator, shape: tuple[int, ...], sign: float = 1.0) -> Floats:
    return sign * np.exp(rng.normal(0, LOG_SD, shape))


RATINGS = partial(_normal, sd=RATING_SD)
PAIRED = (
    Population("normal", _normal, _normal),
    Population("skewed to larger", _log_normal, _log_normal),
    Population("skewed to smaller", partial(_log_normal, sign=-1.0), _log_normal),
    Population("tied (rounded, SD 1.5)", RATINGS, RATINGS, is_rounded=True),
)
UNPAIRED = (
    PAIRED[0],
    Population("skewed", _log_normal, _log_normal),
    PAIRED[3],
    Population("normal, twice the SD", _normal, partial(_normal, sd=2.0)),
)


class Cell(Struct):
    """Coverage in one design, population, size and effect."""

    is_paired: bool
    population: str
    n: int
    effect: float
    covered: dict[str, float]
    none: float
    """Share of data without an interval of the correlation."""


def sample(
    population: Population, shift: float, rng: np.random.Generator, shape: tuple[int, ...], *, paired: bool
) -> tuple[Floats, Floats]:
    """Draw values of both conditions; the first of a pair is 0, because only differences matter."""
    first = np.zeros(shape) if paired else population.draw(rng, shape)
    second = (population.draw if paired else population.second)(rng, shape) + shift
    return (np.rint(first), np.rint(second)) if population.is_rounded else (first, second)


@cache
def truths(population: Population, effect: float, *, paired: bool) -> tuple[float, dict[str, float]]:
    """Return the shift that has an effect, and what each interval should cover, from a large sample."""

    def drawn(shift: float) -> tuple[Floats, Floats]:
        return sample(population, shift, np.random.default_rng(1), (LARGE,), paired=paired)

    def correlation(shift: float) -> float:
        first, second = drawn(shift)
        return float(matched_rank_biserial(second - first) if paired else rank_biserial(first, second))

    low, high = -8.0, 8.0
    for _ in range(24):
        middle = (low + high) / 2
        low, high = (middle, high) if correlation(middle) < effect else (low, middle)
    first, second = drawn(high)
    rng = np.random.default_rng(2)
    other = rng.permutation(second if paired else first)
    middle = float(np.median((second + other) / 2 if paired else second - other))
    return high, {"r": correlation(high), "shift": middle, "mean": float(second.mean() - first.mean())}


def effect_limits(firsts: Floats, seconds: Floats, *, paired: bool) -> Floats:
    """Return the limits (studies, 2) of the report's correlation; equal ranks are evaluated once."""
    n = firsts.shape[1]
    values = seconds - firsts if paired else np.concatenate((firsts, seconds), axis=1)
    ranks = stats.rankdata(np.abs(values) if paired else values, axis=1)
    sums = (ranks * np.sign(values)).sum(axis=1) if paired else ranks[:, n:].sum(axis=1)
    keys = np.column_stack((np.sort(ranks, axis=1), (values == 0).sum(axis=1), sums))
    _, which, back = np.unique(keys, axis=0, return_index=True, return_inverse=True)
    effect = paired_effect if paired else unpaired_effect
    found = [effect(firsts[row], seconds[row], 0) for row in which]
    return np.array([(each.low, each.high) for each in found])[back.ravel()]


def t_limits(firsts: Floats, seconds: Floats, *, paired: bool) -> Floats:
    """Return the limits (studies, 2) of the t interval, which the report leaves out."""
    tested = (
        stats.ttest_rel(seconds, firsts, axis=1)
        if paired
        else stats.ttest_ind(seconds, firsts, axis=1, equal_var=False)
    )
    return np.column_stack(tested.confidence_interval(0.95))


def not_rejected(firsts: Floats, seconds: Floats, difference: float, *, paired: bool) -> float:
    """Return the share of studies whose exact test over mid-ranks does not reject a difference."""
    test = signed_rank if paired else rank_sum
    p = [test(first + difference, second).p for first, second in zip(firsts, seconds, strict=True)]
    return float(np.mean(np.array(p) > 0.05))


def coverage(population: Population, n: int, effect: float, repeats: int, *, paired: bool) -> Cell:
    """Simulate one cell.

    Args:
        population: Where the values come from.
        n: Of pairs, or of values in each sample.
        effect: The true correlation.
        repeats: Simulated studies.
        paired: The design.
    """
    shift, truth = truths(population, effect, paired=paired)
    rng = np.random.default_rng([n, round(100 * effect), paired, len(population.name)])
    firsts, seconds = sample(population, shift, rng, (repeats, n), paired=paired)
    shifts = map(paired_shift if paired else unpaired_shift, firsts, seconds)
    limits = {
        "r": effect_limits(firsts, seconds, paired=paired),
        "shift": np.array([(each.low, each.high) for each in shifts]),
        "mean": t_limits(firsts, seconds, paired=paired),
    }
    covered = {"test": math.nan}
    if population.is_rounded:
        covered["test"] = not_rejected(firsts, seconds, truth["shift"], paired=paired)
    for name, found in limits.items():
        low, high = found[np.isfinite(found).all(axis=1)].T
        covered[name] = float(np.mean((low - 1e-9 <= truth[name]) & (truth[name] <= high + 1e-9)))
    none = float(np.mean(~np.isfinite(limits["r"]).all(axis=1)))
    return Cell(paired, population.name, n, effect, covered, none)


def table(cells: list[Cell]) -> str:
    """Return a row per design, population and size, and three effects a column, as Markdown."""
    head = [
        "design",
        "values",
        "n",
        "rank-biserial r",
        "Hodges-Lehmann",
        "exact test (left out)",
        "t (left out)",
        "without r interval",
    ]
    lines = [head, ["---", "---", *["---:"] * 6]]
    rows = dict.fromkeys((cell.is_paired, cell.population, cell.n) for cell in cells)
    for is_paired, population, n in rows:
        here = [
            cell for cell in cells if (cell.is_paired, cell.population, cell.n) == (is_paired, population, n)
        ]
        names = ("r", "shift", "test", "mean")
        parts = [" / ".join(f"{cell.covered[name]:.3f}" for cell in here) for name in names]
        parts = ["" if "nan" in part else part for part in parts]
        none = " / ".join(f"{cell.none:.3f}" for cell in here)
        lines.append(["paired" if is_paired else "unpaired", population, str(n), *parts, none])
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def main() -> None:
    """Simulate all cells and renew the table in docs/explanation/study_report.md."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--repeats", type=int, default=10_000)
    parser.add_argument("--sizes", type=int, nargs="+", default=SIZES)
    parser.add_argument("--print-only", action="store_true", help="do not write into the docs")
    given = parser.parse_args()
    cells = [
        coverage(population, n, effect, given.repeats, paired=paired)
        for paired, populations in ((True, PAIRED), (False, UNPAIRED))
        for population in populations
        for n in given.sizes
        for effect in EFFECTS
    ]
    text = table(cells)
    print(text)
    if not given.print_only:
        page = Path(__file__).parents[1] / "docs/explanation/study_report.md"
        renew(page, {"coverage": text}, "make interval-coverage")


if __name__ == "__main__":
    main()
