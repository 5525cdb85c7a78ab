"""Draw single moments into the caller's axes: a scene graph, and an observation over the displayed image."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from haptigraph.figures import FancyArrowPatch, Figure
from haptigraph.geometry import Geometry, Point, Polyline, Segment, Vec, rotate, subtract
from haptigraph.graph import SceneGraph
from haptigraph.messages import Step
from haptigraph.perception.eye_view import EyeView
from haptigraph.registration.camera import Registration
from haptigraph.registration.registered import BaseRegistration

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["draw_graph", "draw_overlay", "graph_figure"]

CONE_COLOR = "#7fd08a"
LABEL_AT = 0.38  # share of an edge; edges cross in its middle


def graph_figure(graph: SceneGraph, output: str | Path) -> None:
    """Draw one scene graph to a PNG, SVG or PDF file."""
    figure = Figure(figsize=(5, 4.2), layout="constrained")
    draw_graph(figure.subplots(), graph)
    figure.savefig(output, dpi=150)


def draw_graph(axes: "Axes", graph: SceneGraph) -> None:
    """Draw a scene graph: instruments on the left, other nodes on the right, predicates between them."""
    groups = list(dict.fromkeys(node.group for node in graph.nodes))
    positions: dict[str, Vec] = {}
    for column, group in enumerate(groups):
        members = [node.id for node in graph.nodes if node.group == group]
        for row, name in enumerate(members):
            positions[name] = (2.4 * column, 1.0 - 2.0 * (row + 0.5) / len(members))
    for edge in graph.edges:
        start, end = positions[edge.subject], positions[edge.object]
        arrow = FancyArrowPatch(
            start, end, arrowstyle="-|>", mutation_scale=12, shrinkA=13, shrinkB=13, color="#555"
        )
        axes.add_patch(arrow)
    for (subject, object_), names in _labels(graph).items():
        start, end = positions[subject], positions[object_]
        axes.annotate(
            names,
            (start[0] + LABEL_AT * (end[0] - start[0]), start[1] + LABEL_AT * (end[1] - start[1])),
            ha="center",
            va="center",
            fontsize=7.5,
            bbox={"boxstyle": "round,pad=0.15", "facecolor": "white", "edgecolor": "none", "alpha": 0.9},
        )
    for node in graph.nodes:
        x, y = positions[node.id]
        color = "#f6d58a" if node.group == groups[0] else "#bcdcf2"
        axes.plot([x], [y], "o", markersize=19, color=color, markeredgecolor="#555", zorder=3)
        left = node.group == groups[0]
        axes.annotate(
            node.id.replace("_", "\n"),
            (x + (-0.28 if left else 0.28), y),
            ha="right" if left else "left",
            va="center",
            fontsize=7.5,
        )
    axes.set(xlim=(-1.3, 2.4 * max(len(groups) - 1, 1) + 1.3), ylim=(-1.15, 1.15))
    axes.axis("off")


def _labels(graph: SceneGraph) -> dict[tuple[str, str], str]:
    """Return the predicates between each pair of nodes, as one text per pair."""
    labels: dict[tuple[str, str], str] = {}
    for edge in graph.edges:
        pair = edge.subject, edge.object
        labels[pair] = f"{labels[pair]}\n{edge.predicate}" if pair in labels else edge.predicate
    return labels


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
        for name, shape in shapes.items():
            has_end = not name.endswith("_line") or name.replace("_line", "_tip") in found
            _draw_shape(axes, view, name, shape, "-" if has_end else "--")
    axes.set(xlim=(0, view.size_px - 1), ylim=(view.size_px - 1, 0))
    axes.axis("off")


def _draw_shape(axes: "Axes", view: EyeView, name: str, shape: Geometry, linestyle: str) -> None:
    color, label = "#ffcc33" if name.startswith("needle") else "#5ec8ff", name.replace("_", " ")
    if isinstance(shape, Polyline):
        _line(axes, view, shape.points_mm, color=color, linewidth=1.0, alpha=0.7, label=label)
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
