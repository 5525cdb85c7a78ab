"""Health of the loop, its recorder and its device, and the broken claims about time, as a message."""

import math
import time
from typing import Any

import numpy as np

from haptigraph.analysis.metrics.run import RunMeasures
from haptigraph.dashboard.server.hub import Hub
from haptigraph.pipeline import Loop

__all__ = ["Health"]


class Health:
    """Read the health of a loop; called twice a second from the server's thread, which only reads.

    Args:
        loop: The loop.
        hub: Source of latencies and faults.
        measures: Of the run, kept up to date by the consumer of the loop's steps.
    """

    def __init__(self, loop: Loop, hub: Hub, measures: RunMeasures) -> None:
        self._loop, self._hub, self._measures = loop, hub, measures
        self._previous = loop.report.steps, time.perf_counter()

    def __call__(self) -> dict[str, Any]:
        """Return the fields of the health message."""
        report, latencies_ns = self._loop.report, list(self._hub.latencies_ns)
        p50_ms, p99_ms = np.percentile(latencies_ns, (50, 99)) / 1e6 if latencies_ns else (math.nan, math.nan)
        return {
            "now_ms": self._hub.now_ms(),
            "rate_hz": round(self._rate_hz(), 2),
            "nominal_hz": self._loop.source.rate_hz,
            "latency_p50_ms": _round(p50_ms),
            "latency_p99_ms": _round(p99_ms),
            "steps": report.steps,
            "overruns": report.overruns,
            "skipped": report.skipped,
            "dropped": sum(sink.dropped for sink in self._loop.sinks),
            "faults": self._hub.last_faults,
            "broken": [
                {"claim": kept.name, "times": kept.broken, "worst": round(kept.most, 1), "unit": kept.unit}
                for kept in self._measures.claims
                if kept.broken
            ],
            "viewers": [viewer.name for viewer in self._hub.viewers],
        }

    def _rate_hz(self) -> float:
        now = self._loop.report.steps, time.perf_counter()
        (steps, then_s), self._previous = self._previous, now
        return (now[0] - steps) / max(now[1] - then_s, 1e-3)


def _round(value_ms: float) -> float | None:
    return None if math.isnan(value_ms) else round(float(value_ms), 2)
