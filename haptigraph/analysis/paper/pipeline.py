"""The processing sequence on one image: the paper's own perception above, the tracker's below."""

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from haptigraph.analysis.paper.stages import FilterTrace, Stages
from haptigraph.analysis.paper.views import show_image
from haptigraph.analysis.plots.paper import COLORS, WIDTH_IN, letter, scale_bar
from haptigraph.figures import ConstrainedLayoutEngine, Figure
from haptigraph.imaging import FloatImage, grey_of
from haptigraph.perception.needle.search import MIN_SCORE
from haptigraph.registration.camera import Registration

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["pipeline_figure"]

BAR_MM, STRIP_BAR_MM, ACROSS_BAR_MM = 5.0, 2.0, 0.5
MARGIN_MM = 1.0  # about the globe
HEIGHT_IN = 4.6
ROWS = (
    "Perceiver threshold: the paper's adaptive Gaussian threshold, contour and moving average",
    "Perceiver tracker: search, rectified strip, shaft line, tip and Kalman filter",
)
LEGEND: dict[str, Any] = {"loc": "upper center", "bbox_to_anchor": (0.5, -0.02), "borderpad": 0.1}


def pipeline_figure(stages: Stages, registration: Registration) -> Figure:
    """Draw every stage of one image.

    Args:
        stages: What the stages make of it.
        registration: The static anatomy.
    """
    frontal = registration.frontal
    layout = ConstrainedLayoutEngine(w_pad=0.03, h_pad=0.03, wspace=0.04, hspace=0.1, rect=(0, 0, 1, 0.96))
    figure = Figure(figsize=(WIDTH_IN, HEIGHT_IN), layout=layout)
    upper, lower = figure.subplots(2, 6)
    for row, name in zip((upper, lower), ROWS, strict=True):
        place = {"xy": (0, 1), "xytext": (0, 15), "textcoords": "offset points"}
        row[0].annotate(name, xycoords="axes fraction", fontstyle="italic", in_layout=False, **place)
    _raw(upper[0], stages, registration)
    _globe(upper[1], stages, frontal)
    _retina(upper[2], stages, frontal)
    _threshold(upper[3], stages, frontal)
    _contour(upper[4], stages, frontal)
    _filter(upper[5], stages.average, "moving average")
    _search(lower[0], stages)
    _strip(lower[1], stages, frontal)
    _edges(lower[2], stages, frontal)
    _coarse_tip(lower[3], stages, frontal)
    _subpixel_tip(lower[4], stages, frontal)
    _filter(lower[5], stages.pose, "filter")
    names = (
        *("raw", "globe", "retina", "threshold", "contour", "moving average"),
        *("search", "rectified strip", "edges, shaft line", "coarse tip", "sub-pixel tip", "filter"),
    )
    for axes, name, title in zip([*upper, *lower], "abcdefghijkl", names, strict=True):
        letter(axes, name, title)
        axes.set_anchor("N")
    return figure


def _raw(axes: "Axes", stages: Stages, registration: Registration) -> None:
    show_image(axes, stages.image)
    scale_bar(axes, BAR_MM / registration.image.mm_per_px, f"{BAR_MM:g} mm")


def _crop(axes: "Axes", stages: Stages, registration: Registration) -> None:
    """Show the globe's part of the image, grey."""
    axes.imshow(grey_of(stages.frontal), cmap="gray", vmin=0, vmax=255)
    _limit(axes, registration)


def _limit(axes: "Axes", registration: Registration) -> None:
    x, y = registration.image.center_px
    radius = (registration.globe.radius_mm + MARGIN_MM) / registration.image.mm_per_px
    axes.set(xlim=(x - radius, x + radius), ylim=(y + radius, y - radius))
    axes.axis("off")
    scale_bar(axes, BAR_MM / registration.image.mm_per_px, f"{BAR_MM:g} mm")


def _globe(axes: "Axes", stages: Stages, registration: Registration) -> None:
    _crop(axes, stages, registration)
    angles = np.linspace(0, 2 * math.pi, 200)
    x, y = registration.image.center_px
    radius = registration.globe.radius_mm / registration.image.mm_per_px
    axes.plot(x + radius * np.cos(angles), y + radius * np.sin(angles), color=COLORS["sky"], label="globe")
    trocar = registration.image.to_px(registration.trocar.at_mm)
    axes.plot(*trocar, "^", color=COLORS["orange"], markersize=4, label="trocar")
    axes.legend(**LEGEND, ncols=1)


def _retina(axes: "Axes", stages: Stages, registration: Registration) -> None:
    _crop(axes, stages, registration)
    points = np.array([registration.image.to_px(point) for point in registration.retina.points_mm])
    axes.plot(points[:, 0], points[:, 1], color=COLORS["sky"], linestyle=(0, (4, 1)), label="retina")
    target = registration.image.to_px(registration.target.at_mm)
    axes.plot(*target, "o", color=COLORS["orange"], markerfacecolor="none", markersize=5, label="target")
    axes.legend(**LEGEND, ncols=1)


def _threshold(axes: "Axes", stages: Stages, registration: Registration) -> None:
    (left, top), over = stages.threshold.corner_px, stages.threshold.is_over
    whole = np.zeros(stages.frontal.shape[:2], np.bool_)
    whole[top : top + over.shape[0], left : left + over.shape[1]] = over
    axes.imshow(whole, cmap="gray", interpolation="nearest")
    _limit(axes, registration)


def _contour(axes: "Axes", stages: Stages, registration: Registration) -> None:
    _crop(axes, stages, registration)
    contour, ends = stages.threshold.contour_px, stages.threshold.ends_px
    if contour is None or ends is None:
        axes.text(0.5, 0.5, "no needle found", color="white", ha="center", transform=axes.transAxes)
        return
    axes.plot(contour[:, 0], contour[:, 1], color=COLORS["sky"], linewidth=0.8, label="contour")
    axes.plot(ends[:, 0], ends[:, 1], color=COLORS["orange"], linestyle="--", linewidth=0.8, label="line fit")
    axes.plot(*ends[1], "x", color=COLORS["yellow"], markersize=4, label="tip")
    axes.legend(**LEGEND, ncols=1)


def _filter(axes: "Axes", trace: FilterTrace, name: str) -> None:
    times = np.array(trace.time_s)
    filtered, sd = np.array(trace.filtered_mm), np.array(trace.sd_mm)
    axes.plot(times, trace.measured_mm, ".", color=COLORS["orange"], markersize=2, label="one image")
    axes.plot(times, filtered, color=COLORS["blue"], linewidth=0.9, label=name)
    if np.isfinite(sd).any():
        low, high = filtered - 2 * sd, filtered + 2 * sd
        axes.fill_between(times, low, high, color=COLORS["sky"], alpha=0.5, linewidth=0, label="± 2 s.d.")
    _plot_axes(axes, "time [s]", "tip depth [mm]")


def _search(axes: "Axes", stages: Stages) -> None:
    search = stages.search
    axes.plot(search.angles_deg, search.scores, color=COLORS["black"], linewidth=0.7, label="score")
    axes.axhline(MIN_SCORE, color=COLORS["grey"], linestyle="--", linewidth=0.7, label="minimum")
    at = np.interp(search.candidates_deg, search.angles_deg, search.scores)
    axes.plot(search.candidates_deg, at, "v", color=COLORS["red"], markersize=3.5, label="candidates")
    _plot_axes(axes, "angle [°]", "score [cells]")


def _plot_axes(axes: "Axes", x_label: str, y_label: str) -> None:
    axes.set_xlabel(x_label, labelpad=1)
    axes.set_ylabel(y_label, labelpad=1)
    axes.spines[["top", "right"]].set_visible(False)
    axes.tick_params(pad=1.5, length=2)
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.26), borderpad=0.1)


def _strip_image(axes: "Axes", stages: Stages, registration: Registration) -> None:
    """Show the strip less the background, stations downwards; the scale across is larger than along."""
    strip = stages.detection.candidate.strip
    most = float(np.percentile(np.abs(strip.excess), 99))
    extent = (-strip.half_px - 0.5, strip.half_px + 0.5, float(strip.u_px[-1]), float(strip.u_px[0]))
    axes.imshow(strip.excess.T, cmap="gray", vmin=-most, vmax=most, extent=extent, aspect="auto")
    axes.axis("off")
    mm_per_px = registration.image.mm_per_px
    scale_bar(axes, ACROSS_BAR_MM / mm_per_px, f"{ACROSS_BAR_MM:g} mm")
    scale_bar(axes, STRIP_BAR_MM / mm_per_px, f"{STRIP_BAR_MM:g} mm", down=True)


def _strip(axes: "Axes", stages: Stages, registration: Registration) -> None:
    _strip_image(axes, stages, registration)
    axes.axvline(0, color=COLORS["sky"], linewidth=0.7, linestyle="--", label="expected line")
    axes.legend(**LEGEND)


def _edges(axes: "Axes", stages: Stages, registration: Registration) -> None:
    _strip_image(axes, stages, registration)
    fit = stages.detection.fit
    middle = fit.offset_px + fit.slope * fit.u_px
    for side in (-1, 1):
        edge = middle + side * fit.width_px / 2
        label = "edges" if side < 0 else "_"
        axes.plot(edge, fit.u_px, color=COLORS["sky"], linewidth=0.7, linestyle="--", label=label)
    on = fit.is_on_line
    axes.plot(middle[on], fit.u_px[on], ".", color=COLORS["yellow"], markersize=4, label="blocks on it")
    axes.plot(middle, fit.u_px, color=COLORS["red"], linewidth=0.7, label="shaft line")
    axes.legend(**LEGEND)


def _coarse_tip(axes: "Axes", stages: Stages, registration: Registration) -> None:
    candidate, mm_per_px = stages.detection.candidate, registration.image.mm_per_px
    strip = candidate.strip
    _profile(axes, strip.u_px * mm_per_px, _contrast(strip.excess, strip.half_px, 1))
    at_mm = candidate.tip.u_px * mm_per_px
    axes.axvline(at_mm, color=COLORS["red"], linewidth=0.8, linestyle="--", label="coarse tip")
    _plot_axes(axes, "along the shaft [mm]", "contrast [grey]")


def _subpixel_tip(axes: "Axes", stages: Stages, registration: Registration) -> None:
    detection, mm_per_px = stages.detection, registration.image.mm_per_px
    patch = detection.candidate.patch or detection.candidate.strip
    tip, near = detection.tip, np.abs(patch.u_px - detection.tip.u_px) < 18
    contrast = _contrast(patch.excess, patch.half_px, 1)
    _profile(axes, patch.u_px[near] * mm_per_px, contrast[near], marker=".")
    at_mm, sd_mm = tip.u_px * mm_per_px, math.hypot(tip.sd_px, tip.shift_sd_px) * mm_per_px
    axes.axvspan(
        at_mm - sd_mm, at_mm + sd_mm, color=COLORS["orange"], alpha=0.4, linewidth=0, label="± 1 s.d."
    )
    axes.axvline(at_mm, color=COLORS["red"], linewidth=0.8, linestyle="--", label="tip")
    _plot_axes(axes, "along the shaft [mm]", "contrast [grey]")


def _profile(axes: "Axes", at_mm: FloatImage, contrast: FloatImage, marker: str = "") -> None:
    axes.plot(
        at_mm, contrast, marker=marker, markersize=2, color=COLORS["black"], linewidth=0.7, label="contrast"
    )


def _contrast(excess: FloatImage, half_px: int, lanes: int) -> FloatImage:
    """Return the mean of the middle lanes."""
    return np.asarray(excess[half_px - lanes : half_px + lanes + 1].mean(axis=0))
