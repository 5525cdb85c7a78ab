"""A recorded run as columns for figures: times, steps, intervals of one state, commanded amplitude."""

from typing import Any

import msgspec
from msgspec import Struct

from haptigraph.assemble import parse_procedure
from haptigraph.errors import BadInput
from haptigraph.haptics.observed_device import confirms
from haptigraph.haptics.pattern import amplitude_at
from haptigraph.inference.colors import Paint, palette
from haptigraph.inference.procedure import Procedure
from haptigraph.messages import Delivered, Step
from haptigraph.recording.reader import RunReader

__all__ = ["Series", "read_series", "series_of"]

FINE_NS = 5_000_000
"""Between two samples of the amplitude: fine enough to show every pulse."""


class Series(Struct):
    """A run as columns."""

    time_s: list[float]
    steps: list[Step]
    procedure: Procedure
    paints: dict[str, Paint]
    """By state."""
    confirmed_s: list[tuple[float, float]] | None = None
    """When an output confirmed that it vibrated [s]; None: no output of the run confirms anything."""

    def color(self, state: str) -> str:
        """Return the colour of a state."""
        return self.paints[state].color

    def ink(self, state: str) -> str:
        """Return the colour of text on that of a state."""
        return self.paints[state].ink

    def bounds(self, measure: str) -> list[float]:
        """Return the thresholds that the procedure sets on a measure, smallest first."""
        schema = self.procedure.schema
        relations = [other for other in schema.relations if schema.measure_name(other) == measure]
        bounds = {
            bound
            for other in relations
            for bound in (other.at_most, other.below, other.at_least, other.above)
        }
        return sorted(bound for bound in bounds if bound is not None)

    def intervals(self) -> list[tuple[int, int, str]]:
        """Return (first, end, state) of every interval of one state."""
        states = [step.conclusion.state for step in self.steps]
        starts = [row for row in range(len(states)) if row == 0 or states[row] != states[row - 1]]
        return [
            (start, end, states[start]) for start, end in zip(starts, [*starts[1:], len(states)], strict=True)
        ]

    def span_s(self, start: int, end: int) -> tuple[float, float]:
        """Return when an interval begins and ends."""
        return self.time_s[start], self.time_s[min(end, len(self.time_s) - 1)]

    def column(self, measure: str) -> list[float]:
        """Return a measure at every step; nan where it is missing."""
        return [step.graph.measures.get(measure, float("nan")) for step in self.steps]

    def device_faults_s(self) -> list[float]:
        """Return when the device reported a fault [s]."""
        return [
            time_s
            for time_s, step in zip(self.time_s, self.steps, strict=True)
            if any(fault.where == "device" for fault in step.faults)
        ]

    def amplitudes(self) -> tuple[list[float], list[float]]:
        """Return times [s] and the commanded amplitude, sampled finely enough to show every pulse."""
        start_ns = self.steps[0].stamp_ns
        times, amplitudes = [], []
        for step, later in zip(self.steps, [*self.steps[1:], self.steps[-1]], strict=True):
            for stamp_ns in range(step.stamp_ns, max(later.stamp_ns, step.stamp_ns + 1), FINE_NS):
                times.append((stamp_ns - start_ns) / 1e9)
                amplitudes.append(amplitude_at(step.command, stamp_ns))
        return times, amplitudes


def read_series(reader: RunReader) -> Series:
    """Read a recording without its images.

    Raises:
        BadInput: If it has no complete step.
    """
    steps, periods = list[Step](), list[Delivered]()
    for capture, step in reader.records(images=()):
        steps.append(step)
        periods.extend(capture.delivered)
    if not steps:
        raise BadInput("has no complete step to draw", reader.path)
    series = series_of(steps, parse_procedure(reader.info.procedure, f"procedure in {reader.path}"))
    config: dict[str, Any] = msgspec.json.decode(reader.info.config)
    if periods or confirms(config.get("haptics", {}).get("device", "")):
        first_ns = steps[0].stamp_ns
        series.confirmed_s = [
            ((one.start_ns - first_ns) / 1e9, (one.end_ns - first_ns) / 1e9) for one in periods
        ]
    return series


def series_of(steps: list[Step], procedure: Procedure) -> Series:
    """Return steps, at least one, as columns."""
    time_s = [(step.stamp_ns - steps[0].stamp_ns) / 1e9 for step in steps]
    return Series(time_s, steps, procedure, palette(procedure))
