"""The job that writes a run as a table; and how files are sent."""

import tempfile
from collections.abc import Callable
from pathlib import Path

from haptigraph.analysis.metrics.export import run_csv
from haptigraph.dashboard.server.frames import progress, put_frame

__all__ = ["export_csv", "send_file"]

PART_BYTES = 1 << 18


def export_csv(name: str) -> None:
    """Answer with the run as a table."""
    told = progress("writing", 0)
    send_file(lambda output: run_csv(name, output, lambda _, done, total: told(done, done, total)), ".csv")


def send_file(make: Callable[[str], None], suffix: str) -> None:
    """Send a file once it is whole."""
    with tempfile.TemporaryDirectory(prefix="haptigraph-") as folder:
        output = Path(folder) / f"run{suffix}"
        make(str(output))
        with output.open("rb") as file:
            while part := file.read(PART_BYTES):
                put_frame({"type": "part"}, part)
        put_frame({"type": "whole"})
