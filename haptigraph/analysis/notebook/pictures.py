"""Scene graphs and whole runs as figures that notebooks show."""

import io

from haptigraph.analysis.plots.scene_graph import draw_graph
from haptigraph.analysis.plots.series import read_series
from haptigraph.analysis.plots.timeline import draw_timeline
from haptigraph.figures import Figure, rc_context
from haptigraph.graph import SceneGraph
from haptigraph.recording.reader import RunReader

__all__ = ["ShownFigure", "graph_figure", "graph_svg", "run_figure"]


class ShownFigure(Figure):
    """A figure that notebooks show although pyplot does not manage it."""

    def _repr_png_(self) -> bytes:
        file = io.BytesIO()
        self.savefig(file, format="png", dpi=80)
        return file.getvalue()


def graph_figure(graph: SceneGraph) -> ShownFigure:
    """Draw a scene graph."""
    figure = ShownFigure(figsize=(5, 3.4), layout="constrained")
    if graph.nodes:
        draw_graph(figure.subplots(), graph)
    else:
        figure.text(0.5, 0.5, "nothing was detected", ha="center", va="center")
    return figure


def graph_svg(graph: SceneGraph) -> str:
    """Return the drawing of a scene graph as an SVG element; equal graphs give equal text."""
    file = io.StringIO()
    with rc_context({"svg.fonttype": "none", "svg.hashsalt": "haptigraph"}):
        graph_figure(graph).savefig(file, format="svg", metadata={"Date": None})
    text = file.getvalue()
    return text[text.index("<svg") :]


def run_figure(run: RunReader) -> ShownFigure:
    """Draw a recorded run over time: states, angles, distances, haptic output.

    Raises:
        BadInput: If it has no complete step.
    """
    figure = ShownFigure(figsize=(12, 7), layout="constrained")
    draw_timeline(figure, read_series(run))
    return figure
