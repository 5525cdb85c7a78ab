"""Whether the tip's certainty is true: scenes that the network has not learned -> a table, a figure.

`make bench-certainty`, after `make render-unseen`. For each tip the network says how probably it is far from
where it is reported. Of all tips of which it says 10 %, one in ten should be. Images of one needle are alike,
so the intervals come from drawing whole scenes anew (percentile bootstrap). Each image is judged by itself: a
run takes the mean over a needle's images.
"""

import argparse
from collections.abc import Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from itertools import chain, pairwise
from multiprocessing import get_context
from pathlib import Path
from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray
from scipy import stats

from haptigraph.perception.needle.tip_network import MAX_FAR
from rendering.lot import UNSEEN, drawn_scene
from training.tip_rendered import check_rendered, judged_in
from training.tip_shape import FILE
from training.tip_windows import Judged

__all__ = ["Reliability", "main", "printed", "reliability"]

EDGES = 0.0, 0.001, 0.003, 0.01, 0.03, 0.1, 0.3, 0.6, 1.0  # of ranges of probabilities
RESAMPLES, SEED, LEVEL = 2000, 26, 95
MANY_FAR = 0.1  # of a scene's reported tips
PROCESSORS = 2


class Reliability(NamedTuple):
    """What became of the tips of which a range of probabilities was said."""

    low: float
    high: float
    images: int
    predicted: float
    """Mean probability that one is far."""
    far: float
    """Share of those that are."""
    interval: tuple[float, float]
    """Of that share, 95 %."""


class _Tips(NamedTuple):
    """All tips, one value each."""

    scene: NDArray[np.int64]
    predicted: NDArray[np.float64]
    is_far: NDArray[np.bool_]
    z: NDArray[np.float64]

    @classmethod
    def of(cls, judged: Mapping[int, Sequence[Judged]]) -> "_Tips":
        """Return the tips of all scenes, by number, together."""
        scene = [number for number, tips in judged.items() for _ in tips]
        predicted, is_far, z = zip(*chain.from_iterable(judged.values()), strict=True)
        return cls(np.array(scene), np.array(predicted), np.array(is_far), np.array(z))

    def where(self, is_kept: NDArray[np.bool_]) -> "_Tips":
        """Return some of them."""
        return _Tips(*(values[is_kept] for values in self))


def main() -> None:
    """Judge the tips of all unseen scenes, print the table, and draw the figure."""
    args = _parse_arguments()
    check_rendered("tip_reliability", UNSEEN, "render-unseen")
    with ProcessPoolExecutor(PROCESSORS, get_context("spawn")) as pool:
        judged = pool.map(partial(judged_in, weights=np.load(FILE)), UNSEEN)
        by_scene = dict(zip(UNSEEN, judged, strict=True))
    print("\n".join(printed(by_scene)))
    if args.figure:
        _draw(reliability(by_scene), args.figure)


def _parse_arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        description=__doc__,
        epilog="example: python -m training.tip_reliability --figure reliability.png",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--figure", type=Path, metavar="FILE", help="draw it, too, as PNG, PDF or SVG")
    return parser.parse_args()


def reliability(judged: Mapping[int, Sequence[Judged]]) -> list[Reliability]:
    """Return what became of tips, in the order of what was said of them.

    Args:
        judged: The tips of each scene, by its number.
    """
    tips, found = _Tips.of(judged), []
    for low, high in pairwise(EDGES):
        is_in = (tips.predicted >= low) & (tips.predicted < high + (high == EDGES[-1]))
        if is_in.any():
            part = tips.where(is_in)
            shares = float(part.predicted.mean()), float(part.is_far.mean())
            found.append(Reliability(low, high, len(part.scene), *shares, _interval(part)))
    return found


def _interval(tips: _Tips) -> tuple[float, float]:
    """Return the interval of the share that is far, by drawing scenes."""
    _, scene = np.unique(tips.scene, return_inverse=True)
    count, far = np.bincount(scene), np.bincount(scene, tips.is_far)
    if len(count) < 2:
        return 0.0, 1.0
    if not far.any():  # nor in any scene that is drawn again
        return 0.0, float(stats.binomtest(0, len(count)).proportion_ci(LEVEL / 100).high)
    drawn = np.random.default_rng(SEED).integers(len(count), size=(RESAMPLES, len(count)))
    shares = far[drawn].sum(axis=1) / count[drawn].sum(axis=1)
    low, high = np.percentile(shares, [(100 - LEVEL) / 2, (100 + LEVEL) / 2])
    return float(low), float(high)


def printed(judged: Mapping[int, Sequence[Judged]]) -> list[str]:
    """Return the lines of the report.

    Args:
        judged: The tips of each scene, by its number.
    """
    tips = _Tips.of(judged)
    known = tips.where(tips.predicted <= MAX_FAR)
    lines = [
        f"{len(tips.scene)} tips of {len(judged)} scenes; {tips.is_far.mean():.1%} are far",
        f"{'said':>13} {'tips':>6} {'mean':>7} {'far':>7}   {LEVEL} % interval",
    ]
    for row in reliability(judged):
        ends = f"{row.interval[0]:.1%} to {row.interval[1]:.1%}"
        said = f"{100 * row.low:g} to {100 * row.high:g} %"
        lines.append(f"{said:>13} {row.images:6d} {row.predicted:7.2%} {row.far:7.1%}   {ends}")
    count, far = len(known.scene), known.is_far.sum()
    if not count:
        return [*lines, "none is known"]
    low, high = _interval(known)
    z = " / ".join(f"{value:.2f}" for value in np.percentile(known.z, (68, 95, 99.7)))
    lines += [
        f"known, up to {MAX_FAR:.0%}: {count} ({count / len(tips.scene):.1%}); "
        f"far: {far} of these ({far / count:.1%}; {low:.1%} to {high:.1%})",
        f"tip z of these (68 / 95 / 99.7 %): {z}",
    ]
    for number in np.unique(known.scene[known.is_far]):
        is_far = known.is_far[known.scene == number]
        if is_far.mean() >= MANY_FAR:
            point = drawn_scene(int(number)).needle.point
            lines.append(f"scene {number}, a {point}: {is_far.sum()} of {len(is_far)} known tips are far")
    return lines


def _draw(rows: Sequence[Reliability], file: Path) -> None:
    """Draw what became of tips over what was said of them."""
    figure = Figure(figsize=(3.6, 3.4), layout="constrained")
    axes = figure.add_subplot()
    said = 100 * np.array([row.predicted for row in rows])
    far = 100 * np.array([row.far for row in rows])
    ends = 100 * np.transpose([row.interval for row in rows])
    axes.axline((1, 1), slope=1, color="0.6", linewidth=1, label="as often as reported")
    axes.axvline(100 * MAX_FAR, color="0.6", linewidth=1, linestyle=":", label="known up to here")
    axes.errorbar(
        said, far, np.abs(ends - far), fmt="o", markersize=4, capsize=2, label=f"{LEVEL} % interval"
    )
    for name in ("x", "y"):
        axes.set(**{f"{name}scale": "log", f"{name}lim": (0.02, 100)})
        getattr(axes, f"{name}axis").set_major_formatter("{x:g}")
    axes.set(xlabel="probability of a far tip, as reported [%]", ylabel="tips that are far [%]")
    axes.legend(loc="lower right", framealpha=1, edgecolor="none", fontsize="small")
    figure.savefig(file, dpi=200)


if __name__ == "__main__":
    main()
