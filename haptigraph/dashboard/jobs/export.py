"""The jobs that export a run: as a table, as a figure."""

import tempfile
from collections.abc import Callable
from pathlib import Path

from haptigraph.analysis.exporting.csv_table import run_csv
from haptigraph.dashboard.server.stream import progress_reporter, send_message

__all__ = ["export_csv", "export_png"]

PART_BYTES = 1 << 18


def export_csv(name: str) -> None:
    """Send a run as a table."""
    progress = progress_reporter("writing")
    _send_file(
        lambda output: run_csv(name, output, lambda _, done, total: progress(done, done, total)), ".csv"
    )


def export_png(name: str, procedure: str = "") -> None:
    """Send the figure of a run; with another procedure, that of both over time."""
    from haptigraph.analysis.paper.figure import paper_figure  # noqa: PLC0415 - Matplotlib takes seconds
    from haptigraph.analysis.plots.figures import run_figure  # noqa: PLC0415

    send_message({"type": "progress", "what": "drawing", "done": 0, "total": 0})
    if not procedure:
        _send_file(lambda output: run_figure(name, output), ".png")
        return
    progress = progress_reporter("replaying")
    _send_file(
        lambda output: paper_figure(
            name,
            "timeline",
            output,
            procedure=procedure,
            progress=lambda _, done, total: progress(done, done, total),
        ),
        ".png",
    )


def _send_file(write: Callable[[str], None], suffix: str) -> None:
    """Send a file once it is complete."""
    with tempfile.TemporaryDirectory(prefix="haptigraph-") as folder:
        output = Path(folder) / f"run{suffix}"
        write(str(output))
        with output.open("rb") as file:
            while part := file.read(PART_BYTES):
                send_message({"type": "part"}, part)
        send_message({"type": "complete"})
