"""Draw the observation of a single moment over the displayed image, into the caller's axes."""

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from haptigraph.figures import PowerNorm
from haptigraph.geometry import Geometry, Point, Polyline, Segment, Vec, rotate, subtract
from haptigraph.messages import Image, Step
from haptigraph.perception.eye_view import EyeView
from haptigraph.registration.camera import Registration
from haptigraph.registration.registered import BaseRegistration

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["draw_overlay", "grey_norm"]

CONE_COLOR = "#7fd08a"
DARKEST, BRIGHTEST = 1.0, 99.0
"""Percentiles of pictures that are shown black and white."""
MIDDLE_SHARE, LEAST_GAMMA = 0.35, 0.5
"""The median of dim pictures is shown this bright, as far as this gamma reaches."""
INSTRUMENT_COLOR = "#ffcc33"
ANATOMY_COLORS = ("#5ec8ff", "#ff9ecf", "#a6e37f", "#cdb0ff", "#ffffff")
"""Of lines, in the order in which they were found."""


def grey_norm(pictures: Sequence[Image]) -> PowerNorm:
    """Return how to show pictures alike, so that a dim eye is visible beside a bright needle.

    Args:
        pictures: To be shown; 0 is outside the eye.
    """
    inside = [picture[picture > 0] for picture in pictures]
    values = np.concatenate(inside) if sum(map(np.size, inside)) else np.array((0.0, 255.0))
    low, middle, high = np.percentile(values, (DARKEST, 50, BRIGHTEST))
    share = (middle - low) / max(high - low, 1.0)
    gamma = math.log(MIDDLE_SHARE) / math.log(share) if 0 < share < MIDDLE_SHARE else 1.0
    return PowerNorm(max(gamma, LEAST_GAMMA), float(low), float(max(high, low + 1)), clip=True)


def draw_overlay(
    axes: "Axes", view: EyeView, step: Step, registration: BaseRegistration, cone_deg: list[float]
) -> None:
    """Draw an observation, and the cone in which a shaft counts as aligned."""
    if isinstance(registration, Registration):
        trocar = registration.trocar.at_mm
        axis = subtract(registration.target.at_mm, trocar)
        for side_deg in (sign * bound for bound in cone_deg[:1] for sign in (-1, 1)):
            x, y = rotate(axis, side_deg)
            label = f"aligned: within {cone_deg[0]:g}°" if side_deg < 0 else "_"
            ends = trocar, (trocar[0] + x, trocar[1] + y)
            _line(axes, view, ends, color=CONE_COLOR, linewidth=0.8, linestyle=(0, (4, 2)), label=label)
    found = step.observation.found
    for shapes in view.drawn(found):
        lines = [name for name, shape in shapes.items() if isinstance(shape, Polyline)]
        for name, shape in shapes.items():
            has_end = not name.endswith("_line") or name.replace("_line", "_tip") in found
            number = lines.index(name) if name in lines else 0
            color = (
                INSTRUMENT_COLOR
                if name.startswith("needle")
                else ANATOMY_COLORS[number % len(ANATOMY_COLORS)]
            )
            _draw_shape(axes, view, name, shape, color, "-" if has_end else "--")
    axes.set(xlim=(0, view.size_px - 1), ylim=(view.size_px - 1, 0))
    axes.axis("off")


def _draw_shape(axes: "Axes", view: EyeView, name: str, shape: Geometry, color: str, linestyle: str) -> None:
    label = name.replace("_", " ")
    if isinstance(shape, Polyline):
        _line(axes, view, shape.points_mm, color=color, linewidth=1.1, alpha=0.85, label=label)
    elif isinstance(shape, Segment):
        ends = shape.start_mm, shape.end_mm
        _line(axes, view, ends, color=color, linewidth=1.0, linestyle=linestyle, label=label)
    elif isinstance(shape, Point) and name != "trocar":
        is_tip = name == "needle_tip"
        axes.plot(
            *view.to_px(shape.at_mm),
            marker="o", markersize=4 if is_tip else 6, linestyle="none", label=label,
            color=color, markerfacecolor=color if is_tip else "none",
        )  # fmt: skip


def _line(axes: "Axes", view: EyeView, points_mm: Sequence[Vec], **style: object) -> None:
    x, y = zip(*(view.to_px(point) for point in points_mm), strict=True)
    axes.plot(x, y, **style)  # type: ignore[arg-type]
