"""Three views of one moment: the raw image, the displayed picture with the observation, the trigger zones."""

from collections.abc import Mapping
from typing import TYPE_CHECKING

import cv2
import numpy as np

from haptigraph.analysis.paper.zones import draw_zones, zones
from haptigraph.analysis.plots.drawing import draw_overlay, grey_norm
from haptigraph.analysis.plots.paper import COLORS, WIDTH_IN, letter, scale_bar
from haptigraph.analysis.plots.series import Series
from haptigraph.figures import Figure
from haptigraph.geometry import Geometry, Point, Segment
from haptigraph.messages import Image
from haptigraph.perception.eye_view import IoctView
from haptigraph.registration.camera import Registration

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["show_image", "views_figure"]

BAR_MM = 5.0


def views_figure(series: Series, number: int, image: Image, registration: Registration) -> Figure:
    """Draw three views of one step.

    Args:
        series: The run.
        number: The step.
        image: Its image.
        registration: The static anatomy.
    """
    step, view = series.steps[number], IoctView(registration)
    figure = Figure(figsize=(WIDTH_IN, 2.75), layout="constrained")
    raw, displayed, zone = figure.subplots(1, 3, width_ratios=(1.5, 1, 1))
    show_image(raw, image)
    letter(raw, "a", f"raw image, {series.time_s[number]:.2f} s")
    scale_bar(raw, BAR_MM / registration.image.mm_per_px, f"{BAR_MM:g} mm")
    bar_px = BAR_MM * view.size_px / (2 * view.half_mm)
    eye = view(image)
    displayed.imshow(eye, cmap="gray", norm=grey_norm([eye]))
    draw_overlay(displayed, view, step, registration, series.bounds("theta_deg"))
    letter(displayed, "b", f"displayed: {step.conclusion.state.replace('_', ' ')}")
    scale_bar(displayed, bar_px, f"{BAR_MM:g} mm")
    states = zones(series.procedure, registration, view, step.observation)
    patches = draw_zones(zone, series, states)
    _draw_needle(zone, view, step.observation.found)
    zone.set(xlim=displayed.get_xlim(), ylim=displayed.get_ylim(), aspect="equal")
    zone.axis("off")
    letter(zone, "c", "trigger zones")
    scale_bar(zone, bar_px, f"{BAR_MM:g} mm", "black")
    lines, _ = displayed.get_legend_handles_labels()
    figure.legend(handles=[*lines, *patches], loc="outside lower center", ncols=4)
    for axes in (raw, displayed, zone):
        axes.set_anchor("N")
    return figure


def _draw_needle(axes: "Axes", view: IoctView, found: Mapping[str, Geometry]) -> None:
    """Draw tip and shaft in black, as far as they were detected."""
    line, tip = found.get("needle_line"), found.get("needle_tip")
    if isinstance(line, Segment):
        x, y = zip(view.to_px(line.start_mm), view.to_px(line.end_mm), strict=True)
        axes.plot(x, y, color=COLORS["black"])
    if isinstance(tip, Point):
        axes.plot(*view.to_px(tip.at_mm), "o", color=COLORS["black"], markersize=3)


def show_image(axes: "Axes", image: Image) -> None:
    """Show an image as a camera delivers it."""
    if image.ndim == 3:
        axes.imshow(np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2RGB)))
    else:
        axes.imshow(image, cmap="gray", vmin=0, vmax=255)
    axes.axis("off")
