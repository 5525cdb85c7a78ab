"""The job that draws the figure of a run."""

from haptigraph.analysis.plots.figures import run_figure
from haptigraph.dashboard.jobs.export import send_file
from haptigraph.dashboard.server.frames import put_frame

__all__ = ["export_png"]


def export_png(name: str) -> None:
    """Answer with the figure of the run."""
    put_frame({"type": "progress", "what": "drawing", "done": 0, "total": 0})
    send_file(lambda output: run_figure(name, output), ".png")
