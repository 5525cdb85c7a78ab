"""Draw a scene graph into the caller's axes; edges pass nodes by, and labels do not overlap."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from haptigraph.figures import Artist, Bbox, FancyArrowPatch, Figure
from haptigraph.geometry import Vec
from haptigraph.graph import Node, Relation, SceneGraph
from haptigraph.imaging import Floats

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.backend_bases import RendererBase
    from matplotlib.text import Text

__all__ = ["draw_graph", "graph_figure"]

COLORS = ("#f6d58a", "#bcdcf2", "#cfe6c4", "#e3c9ea")
"""Of groups, as on the live page."""
EDGE = "#555555"
FONT_PT, NODE_PT = 7.5, 15.0
COLUMN = 2.4
BENDS = (0.0, 0.2, -0.2, 0.4, -0.4, 0.7)
"""Of an edge, as shares of its length; the first that touches no other node is taken."""
BULGE_PT = 20.0
"""Of an edge within a column, away from its names."""
SHARES = (0.5, 0.42, 0.58, 0.34, 0.66, 0.26, 0.74)
"""Places of a label along its edge; the first without overlap is taken."""


def graph_figure(graph: SceneGraph, output: str | Path) -> None:
    """Draw one scene graph to a PNG, SVG or PDF file."""
    figure = Figure(figsize=(5, 4.2), layout="constrained")
    draw_graph(figure.subplots(), graph)
    figure.savefig(output, dpi=150)


def draw_graph(axes: "Axes", graph: SceneGraph, relations: Sequence[Relation] = ()) -> None:
    """Draw a scene graph: instruments on the left, other nodes on the right, predicates between them.

    Args:
        axes: Empty.
        graph: What to draw.
        relations: All that may hold: they order the nodes alike in every graph of a procedure.
    """
    groups = list(dict.fromkeys(node.group for node in graph.nodes))
    positions = _positions(graph, groups, [(one.subject, one.object) for one in relations])
    names = {}
    for node in graph.nodes:
        x, y = positions[node.id]
        column = groups.index(node.group)
        axes.plot(
            [x],
            [y],
            "o",
            markersize=NODE_PT,
            color=COLORS[column % len(COLORS)],
            markeredgecolor=EDGE,
            zorder=3,
        )
        side = -1 if column == 0 else 1
        names[node.id] = axes.annotate(
            node.id.replace("_", "\n"), (x, y), (side * (NODE_PT / 2 + 2.5), 0), textcoords="offset points",
            ha="right" if side < 0 else "left", va="center", fontsize=FONT_PT, linespacing=1.0,
        )  # fmt: skip
    axes.set(xlim=(-1.3, COLUMN * max(len(groups) - 1, 1) + 1.3), ylim=(-1.15, 1.15))
    axes.axis("off")
    axes.add_artist(_Edges(axes, graph, positions, names))


def _positions(graph: SceneGraph, groups: list[str], pairs: list[tuple[str, str]]) -> dict[str, Vec]:
    """Arrange groups in columns; a column's nodes are ordered like those that relate to them."""
    pairs = pairs or [(edge.subject, edge.object) for edge in graph.edges]
    positions: dict[str, Vec] = {}

    def rank(node: Node) -> float:
        heights = [positions[one][1] for one, other in pairs if other == node.id and one in positions]
        return -float(np.mean(heights)) if heights else np.inf

    for column, group in enumerate(groups):
        members = [node for node in graph.nodes if node.group == group]
        for row, node in enumerate(sorted(members, key=rank) if column else members):
            positions[node.id] = (COLUMN * column, 1.0 - 2.0 * (row + 0.5) / len(members))
    return positions


class _Edges(Artist):
    """The edges of a graph, arranged when they are drawn, because only then sizes are known."""

    def __init__(
        self, axes: "Axes", graph: SceneGraph, positions: dict[str, Vec], names: "Mapping[str, Text]"
    ) -> None:
        super().__init__()
        self.set_in_layout(False)
        self.set_zorder(2)
        self._own_axes, self._positions, self._names = axes, positions, names
        predicates: dict[tuple[str, str], list[str]] = {}
        for edge in graph.edges:
            predicates.setdefault((edge.subject, edge.object), []).append(edge.predicate.replace("_", " "))
        in_columns_first = sorted(predicates, key=lambda pair: positions[pair[0]][0] != positions[pair[1]][0])
        self._edges = [
            (*pair, self._new_arrow(), self._predicates("\n".join(predicates[pair])))
            for pair in in_columns_first
        ]

    def _new_arrow(self) -> FancyArrowPatch:
        """Return an arrow that only this artist draws."""
        gap_pt = NODE_PT / 2 + 1.5
        style: dict[str, Any] = {"arrowstyle": "-|>", "mutation_scale": 10, "color": EDGE, "linewidth": 0.9}
        arrow = FancyArrowPatch((0, 0), (1, 1), shrinkA=gap_pt, shrinkB=gap_pt, **style)
        self._own_axes.add_patch(arrow)
        arrow.set_visible(False)
        return arrow

    def _predicates(self, text: str) -> "Text":
        """Return a label, which is drawn above the edges."""
        box: dict[str, Any] = {"boxstyle": "round,pad=0.12", "facecolor": "white", "edgecolor": "none"}
        style: dict[str, Any] = {"ha": "center", "va": "center", "fontsize": FONT_PT, "linespacing": 1.0}
        label = self._own_axes.text(0, 0, text, bbox=box, zorder=2.5, **style)
        label.set_in_layout(False)
        return label

    def draw(self, renderer: "RendererBase") -> None:
        """Arrange the edges; they are drawn with the axes' other artists."""
        radius, bulge = (float(np.asarray(renderer.points_to_pixels(pt))) for pt in (NODE_PT / 2, BULGE_PT))
        to_px = self._own_axes.transData.transform
        at = {name: np.asarray(to_px(place), np.float64) for name, place in self._positions.items()}
        nodes = {
            name: [Bbox([point - radius, point + radius]), self._names[name].get_window_extent(renderer)]
            for name, point in at.items()
        }
        taken = [box for boxes in nodes.values() for box in boxes]
        to_data = self._own_axes.transData.inverted()
        for subject, object_, arrow, label in self._edges:
            others = [box for name in nodes for box in nodes[name] if name not in (subject, object_)]
            ends = at[subject], at[object_]
            bend = min(BENDS, key=lambda bend: _hits(_curve(*ends, bend), others))
            if ends[0][0] == ends[1][0]:
                side = 1 if self._positions[subject][0] == 0 else -1
                bend = 2 * side * bulge / (ends[1][1] - ends[0][1])
            arrow.set_positions(self._positions[subject], self._positions[object_])
            arrow.set_connectionstyle(f"arc3,rad={bend}")
            arrow.set_visible(True)
            arrow.draw(renderer)
            arrow.set_visible(False)
            curve = _curve(*ends, bend)
            places = []
            for share in SHARES:
                x, y = to_data.transform(curve[round(share * (len(curve) - 1))])
                label.set_position((float(x), float(y)))
                box = label.get_window_extent(renderer).padded(1)
                places.append((sum(_overlap(box, other) for other in taken), label.get_position(), box))
            _, position, box = min(places, key=lambda place: place[0])
            label.set_position(position)
            taken.append(box)


def _curve(start: Floats, end: Floats, bend: float) -> Floats:
    """Return points of an edge, (n, 2): a quadratic curve, bent as Matplotlib's arc3."""
    (dx, dy), shares = end - start, np.linspace(0, 1, 51)[:, None]
    control = (start + end) / 2 + bend * np.array((dy, -dx))
    return np.asarray((1 - shares) ** 2 * start + 2 * shares * (1 - shares) * control + shares**2 * end)


def _hits(curve: Floats, boxes: list[Bbox]) -> int:
    """Count the points of a curve that are in a box."""
    return sum(int(((curve > box.min).all(axis=1) & (curve < box.max).all(axis=1)).sum()) for box in boxes)


def _overlap(one: Bbox, other: Bbox) -> float:
    """Return the area that two boxes share [px²]."""
    common = Bbox.intersection(one, other)
    return float(common.width * common.height) if common else 0.0
