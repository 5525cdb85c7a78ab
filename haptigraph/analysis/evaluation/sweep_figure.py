"""Draw a sweep: error of the angle and of the tip against depth, and the angle's noise beside its bound."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure

from haptigraph.analysis.evaluation.angle_noise import HeldDepth
from haptigraph.analysis.evaluation.sweep import Sweep
from haptigraph.errors import BadInput

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["check_output", "sweep_figure"]

COLORS = ("#b5482a", "#2a6f97", "#3a9d5d", "#8a5fb0")
BOUND_COLOR = "#444444"
EDGES_MM = (0.5, 1.0, 1.5, 2.0, 3.0, 4.5, 6.5, 9.0, 13.0, 18.0, 25.0)
FEWEST = 3  # errors in a bin worth drawing
TICKS_MM = (1, 2, 3, 5, 10, 20)
FORMATS = (".png", ".svg", ".pdf")


def check_output(output: str | Path) -> None:
    """Refuse a figure that could not be written, before the work for it begins.

    Raises:
        BadInput: If there is no such folder or format.
    """
    output = Path(output)
    if output.suffix not in FORMATS:
        raise BadInput(f"not a figure's name; valid endings: {', '.join(FORMATS)}", output)
    if not output.parent.is_dir():
        raise BadInput("cannot be written, there is no such folder", output)


def sweep_figure(sweep: Sweep, held: Sequence[HeldDepth], output: str | Path) -> None:
    """Draw a sweep to a PNG, SVG or PDF.

    Args:
        sweep: Errors by depth.
        held: Noise by depth, with the bound.
        output: The picture to write.
    """
    figure = Figure(figsize=(15, 5.2), layout="constrained")
    angle, noise, tip = figure.subplots(1, 3)
    for color, (perceiver, by_difficulty) in zip(COLORS, sweep.errors.items(), strict=False):
        scenes = [errors for each in by_difficulty.values() for errors in each]
        _draw_errors(angle, perceiver, color, [pair for errors in scenes for pair in errors.angles_deg])
        _draw_errors(tip, perceiver, color, [pair for errors in scenes for pair in errors.tips_px])
        _draw_noise(noise, perceiver, color, held)
    _draw_bounds(noise, held)
    angle.set(title="Error of the angle, all scenes", ylabel="error of the shaft's direction [deg]")
    noise.set(title="Noise of the angle, needle held still", ylabel="deviation from image to image [deg]")
    tip.set(title="Error of the tip, all scenes", ylabel="error of the tip [px]")
    for axes in (angle, noise, tip):
        _dress(axes)
    figure.suptitle(f"{sweep.scenes} simulated scenes, seed {sweep.seed}")
    figure.savefig(output, dpi=110)


def _draw_errors(axes: "Axes", name: str, color: str, pairs: Sequence[tuple[float, float]]) -> None:
    """Draw the median of errors as a line and up to their 95th percentile as a band, by depth."""
    depth_mm, error = np.array(pairs, np.float64).reshape(-1, 2).T
    bins = np.digitize(depth_mm, EDGES_MM)
    rows = [
        (np.median(depth_mm[bins == bin_]), *np.percentile(error[bins == bin_], (50, 95)))
        for bin_ in range(1, len(EDGES_MM))
        if (bins == bin_).sum() >= FEWEST
    ]
    if not rows:
        return
    places, median, p95 = np.array(rows).T
    axes.fill_between(places, median, p95, color=color, alpha=0.15, linewidth=0)
    axes.plot(places, p95, color=color, linewidth=0.9, linestyle="--", label=f"{name}, 95th percentile")
    axes.plot(places, median, color=color, linewidth=1.8, marker="o", markersize=3.5, label=f"{name}, median")


def _draw_noise(axes: "Axes", name: str, color: str, held: Sequence[HeldDepth]) -> None:
    depths_mm = [each.depth_mm for each in held]
    noise_deg = [_or_nan(each.noise_deg[name]) for each in held]
    axes.plot(depths_mm, noise_deg, color=color, linewidth=1.8, marker="o", markersize=3.5, label=name)


def _draw_bounds(axes: "Axes", held: Sequence[HeldDepth]) -> None:
    depths_mm = [each.depth_mm for each in held]
    free = [each.bound.inside_rcm_free_deg for each in held]
    known = [each.bound.inside_deg for each in held]
    both = [each.bound.both_rcm_free_deg for each in held]
    for bound_deg, line, says in (
        (free, ":", "inside, pivot unknown"),
        (known, "-", "inside, pivot known"),
        (both, "-.", "both sides of the wall, pivot unknown"),
    ):
        label = f"bound: {says}"
        axes.plot(depths_mm, bound_deg, linestyle=line, color=BOUND_COLOR, linewidth=1.3, label=label)


def _dress(axes: "Axes") -> None:
    axes.set(xscale="log", yscale="log", xlabel="depth inside, from the pivot [mm]", xlim=(0.8, 25))
    axes.set_xticks(TICKS_MM, labels=[str(tick) for tick in TICKS_MM])
    axes.set_xticks([], minor=True)
    axes.grid(which="major", color="#dddddd", linewidth=0.7)
    axes.set_axisbelow(True)
    axes.spines[["top", "right"]].set_visible(False)
    if axes.get_legend_handles_labels()[0]:
        axes.legend(fontsize=8, frameon=True, framealpha=0.85, edgecolor="none", loc="best")


def _or_nan(value: float | None) -> float:
    return float("nan") if value is None else value
