"""Draw a sweep: errors of angle and tip against depth, and the angle noise with its Cramer-Rao bound."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from haptigraph.analysis.evaluation.angle_noise import HeldDepth
from haptigraph.analysis.evaluation.sweep import Sweep
from haptigraph.errors import BadInput
from haptigraph.figures import Figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["check_output", "sweep_figure"]

COLORS = ("#b5482a", "#2a6f97", "#3a9d5d", "#8a5fb0")
BOUND_COLOR = "#444444"
EDGES_MM = (0.5, 1.0, 1.5, 2.0, 3.0, 4.5, 6.5, 9.0, 13.0, 18.0, 25.0)
MIN_BIN_ERRORS = 3  # bins with fewer errors are not drawn
TICKS_MM = (1, 2, 3, 5, 10, 20)
FORMATS = (".png", ".svg", ".pdf")


def check_output(output: str | Path) -> None:
    """Refuse a figure that cannot be written, before the work for it begins.

    Raises:
        BadInput: If its folder does not exist, or its format is unknown.
    """
    output = Path(output)
    if output.suffix not in FORMATS:
        raise BadInput(f"not a figure's name; valid endings: {', '.join(FORMATS)}", output)
    if not output.parent.is_dir():
        raise BadInput("cannot be written; there is no such folder", output)


def sweep_figure(sweep: Sweep, held: Sequence[HeldDepth], output: str | Path) -> None:
    """Draw a sweep to a PNG, SVG or PDF file.

    Args:
        sweep: Errors by depth.
        held: Noise by depth, with the bound.
        output: The file to write.
    """
    figure = Figure(figsize=(12.5, 4.6), layout="constrained")
    angle, noise, tip = figure.subplots(1, 3)
    for color, (perceiver, by_condition) in zip(COLORS, sweep.errors.items(), strict=False):
        scenes = [errors for each in by_condition.values() for errors in each]
        _draw_errors(angle, perceiver, color, [pair for errors in scenes for pair in errors.angles_deg])
        _draw_errors(tip, perceiver, color, [pair for errors in scenes for pair in errors.tips_px])
        _draw_noise(noise, perceiver, color, held)
    _draw_bounds(noise, held)
    angle.set(title="Angle error, all scenes", ylabel="error of the shaft's direction [deg]")
    noise.set(title="Angle noise, needle stationary", ylabel="standard deviation between images [deg]")
    tip.set(title="Tip error, all scenes", ylabel="error of the tip [px]")
    for axes in (angle, noise, tip):
        _style_axes(axes)
    figure.suptitle(f"{sweep.scenes} simulated scenes, seed {sweep.seed}")
    figure.savefig(output, dpi=130)


def _draw_errors(axes: "Axes", name: str, color: str, pairs: Sequence[tuple[float, float]]) -> None:
    """Draw errors by depth: the median as a line, the band up to the 95th percentile."""
    depth_mm, error = np.array(pairs, np.float64).reshape(-1, 2).T
    bins = np.digitize(depth_mm, EDGES_MM)
    rows = [
        (np.median(depth_mm[bins == bin_]), *np.percentile(error[bins == bin_], (50, 95)))
        for bin_ in range(1, len(EDGES_MM))
        if (bins == bin_).sum() >= MIN_BIN_ERRORS
    ]
    if not rows:
        return
    depths, median, p95 = np.array(rows).T
    axes.fill_between(depths, median, p95, color=color, alpha=0.15, linewidth=0)
    axes.plot(depths, p95, color=color, linewidth=0.9, linestyle="--", label=f"{name}, 95th percentile")
    axes.plot(depths, median, color=color, linewidth=1.8, marker="o", markersize=3.5, label=f"{name}, median")


def _draw_noise(axes: "Axes", name: str, color: str, held: Sequence[HeldDepth]) -> None:
    depths_mm = [each.depth_mm for each in held]
    noise_deg = [_nan_if_none(each.noise_deg[name]) for each in held]
    axes.plot(depths_mm, noise_deg, color=color, linewidth=1.8, marker="o", markersize=3.5, label=name)


def _draw_bounds(axes: "Axes", held: Sequence[HeldDepth]) -> None:
    depths_mm = [each.depth_mm for each in held]
    rcm_free = [each.bound.inside_rcm_free_deg for each in held]
    rcm_known = [each.bound.inside_deg for each in held]
    both = [each.bound.both_rcm_free_deg for each in held]
    for bound_deg, line, condition in (
        (rcm_free, ":", "inside, RCM unknown"),
        (rcm_known, "-", "inside, RCM known"),
        (both, "-.", "both sides of the wall, RCM unknown"),
    ):
        label = f"bound: {condition}"
        axes.plot(depths_mm, bound_deg, linestyle=line, color=BOUND_COLOR, linewidth=1.3, label=label)


def _style_axes(axes: "Axes") -> None:
    axes.set(xscale="log", yscale="log", xlabel="depth inside, from the RCM [mm]", xlim=(0.8, 25))
    axes.set_xticks(TICKS_MM, labels=[str(tick) for tick in TICKS_MM])
    axes.set_xticks([], minor=True)
    axes.grid(which="major", color="#dddddd", linewidth=0.7)
    axes.set_axisbelow(True)
    axes.spines[["top", "right"]].set_visible(False)
    if axes.get_legend_handles_labels()[0]:
        axes.legend(fontsize=8, frameon=True, framealpha=0.85, edgecolor="none", loc="best")


def _nan_if_none(value: float | None) -> float:
    return float("nan") if value is None else value
