"""Streams of messages, JSON with bytes, as jobs answer; and runs encoded as columns of numbers.

`static/recordings/stream.js` reads them.
"""

import sys
from collections.abc import Callable
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from haptigraph.analysis.metrics.run import RunMeasures
from haptigraph.analysis.metrics.timeline import Timeline
from haptigraph.dashboard.server.protocol import pack

__all__ = ["encode_timeline", "measures_json", "pack_message", "progress_reporter", "send_message"]

PROGRESS_STEPS = 500


def pack_message(content: dict[str, Any], data: bytes = b"") -> bytes:
    """Encode one message; its JSON gets the length of the data as `bytes`."""
    return pack({**content, "bytes": len(data)}, data)


def send_message(content: dict[str, Any], data: bytes = b"") -> None:
    """Write one message to stdout."""
    sys.stdout.buffer.write(pack_message(content, data))
    sys.stdout.buffer.flush()


def progress_reporter(what: str, total: int = 0) -> Callable[..., None]:
    """Return a function (steps, done, total) that sends progress messages, one in `PROGRESS_STEPS` steps."""

    def report(steps: int, done: int, total: int = total) -> None:
        if steps % PROGRESS_STEPS == 1 or steps == total:
            send_message({"type": "progress", "what": what, "done": done, "total": total})

    return report


def encode_timeline(timeline: Timeline) -> tuple[dict[str, Any], bytes]:
    """Encode a timeline as JSON that describes its columns, and the columns: little-endian, widest first."""
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


def measures_json(measures: RunMeasures, start_ns: int) -> dict[str, Any]:
    """Return the measures of a run as JSON content; times count from `start_ns`, the first step's stamp."""
    started, ended, last = measures.started_ns, measures.ended_ns, measures.last
    return {
        "ends_in": measures.span.ends_in,
        "started_ms": None if started is None else (started - start_ns) / 1e6,
        "ended_ms": None if ended is None else (ended - start_ns) / 1e6,
        "completion_s": measures.completion_s,
        "mean_theta_deg": measures.mean_theta_deg,
        "contacts": measures.contacts,
        "changes": measures.state_changes,
        "claims": [{"name": one.name, "cases": one.cases, "broken": one.broken} for one in measures.claims],
        "steps": measures.steps,
        "tipless_steps": measures.tipless_steps,
        "longest_tipless_s": measures.longest_tipless_s,
        "state_s": measures.state_s,
        "all_state_s": measures.all_state_s,
        "length_s": 0.0 if last is None else (last.stamp_ns - start_ns) / 1e9,
    }
