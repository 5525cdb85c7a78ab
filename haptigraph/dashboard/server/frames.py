"""How jobs answer: frames of JSON with bytes behind it; and how runs are written down in them, as columns.

Knows how things are written, not where they come from. `static/recordings/frames.js` reads it.
"""

import sys
from collections.abc import Callable
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from haptigraph.analysis.metrics.run import RunMeasures
from haptigraph.analysis.metrics.timeline import Timeline

__all__ = ["framed", "measures_told", "progress", "put_frame", "timeline_told"]

TOLD_EVERY = 500  # steps between two words about progress


def framed(content: dict[str, Any], data: bytes = b"") -> bytes:
    """Return one frame: length of the JSON (4 bytes, big-endian), JSON, bytes."""
    text = msgspec.json.encode({**content, "bytes": len(data)})
    return len(text).to_bytes(4, "big") + text + data


def put_frame(content: dict[str, Any], data: bytes = b"") -> None:
    """Write one frame to stdout."""
    sys.stdout.buffer.write(framed(content, data))
    sys.stdout.buffer.flush()


def progress(what: str, all_bytes: int) -> Callable[..., None]:
    """Return what tells the page how far a job is: (steps done, done, total); now and then."""

    def told(steps: int, done: int, total: int = all_bytes) -> None:
        if steps % TOLD_EVERY == 1 or steps == total:
            put_frame({"type": "progress", "what": what, "done": done, "total": total})

    return told


def timeline_told(timeline: Timeline) -> tuple[dict[str, Any], bytes]:
    """Return a timeline as JSON that describes its columns, and the columns: little-endian, widest first."""
    columns: dict[str, NDArray[Any]] = {
        "time_ms": np.asarray(timeline.time_ms, "<f8"),
        "edge_ms": np.asarray(timeline.edge_ms, "<f8"),
        **{f"measure:{name}": np.asarray(column, "<f4") for name, column in timeline.measures.items()},
        "edge_amplitude": np.asarray(timeline.edge_amplitude, "<f4"),
        "state": np.asarray(timeline.state, "<u2"),
        "plays": np.asarray(timeline.plays, "<u2"),
    }
    content = {
        "columns": [[name, column.dtype.str[1:], len(column)] for name, column in columns.items()],
        "states": timeline.states,
        "patterns": timeline.patterns,
        "faults": msgspec.to_builtins(timeline.faults),
    }
    return content, b"".join(column.tobytes() for column in columns.values())


def measures_told(measures: RunMeasures, start_ns: int) -> dict[str, Any]:
    """Return the measures of a run.

    Args:
        measures: Of the run.
        start_ns: Stamp of the first step; the moments are told from there.
    """
    started, ended, last = measures.started_ns, measures.ended_ns, measures.last
    return {
        "ends_in": measures.span.ends_in,
        "started_ms": None if started is None else (started - start_ns) / 1e6,
        "ended_ms": None if ended is None else (ended - start_ns) / 1e6,
        "completion_s": measures.completion_s,
        "mean_theta_deg": measures.mean_theta_deg,
        "contacts": measures.contacts,
        "changes": max(len(measures.order) - 1, 0),
        "claims": [{"name": one.name, "broken": one.broken} for one in measures.claims],
        "state_s": measures.state_s,
        "all_state_s": measures.all_state_s,
        "length_s": 0.0 if last is None else (last.stamp_ns - start_ns) / 1e9,
    }
