"""A run as columns for drawing: time, state, measures, commanded amplitude.

Built step by step; stores about 40 bytes per step, and no images.
"""

from array import array
from collections.abc import Iterable
from math import nan

from msgspec import Struct

from haptigraph.haptics.pattern import amplitude_at, next_change_ns
from haptigraph.messages import HapticCommand, Step

__all__ = ["FaultSpan", "Timeline"]


class FaultSpan(Struct):
    """A fault, and the steps it lasted."""

    first: int
    last: int
    where: str
    message: str


class Timeline:
    """Columns of one run.

    Args:
        states: Names of the states; others are added when they occur.
        measures: Names of the measures to store.
    """

    def __init__(self, states: Iterable[str], measures: Iterable[str]) -> None:
        self.states = list(states)
        self.patterns: list[str] = []
        self.time_ms = array("d")
        """Since the first step."""
        self.state = array("H")
        """Index into `states`."""
        self.plays = array("H")
        """Index into `patterns` of the commanded pattern."""
        self.measures = {name: array("f") for name in measures}
        """nan where a measure is missing."""
        self.edge_ms = array("d")
        """When the commanded amplitude changes; the guard may have limited it."""
        self.edge_amplitude = array("f")
        self.faults: list[FaultSpan] = []
        self.start_ns = 0
        self._last_ns = 0
        self._command: HapticCommand | None = None
        self._open: dict[tuple[str, str], FaultSpan] = {}

    def __len__(self) -> int:
        return len(self.time_ms)

    def add(self, step: Step) -> None:
        """Append the next step."""
        number = len(self)
        if not number:
            self.start_ns = step.stamp_ns
        self._play_until(step.stamp_ns)
        self._command, self._last_ns = step.command, step.stamp_ns
        self._record_amplitude(step.stamp_ns)
        self.time_ms.append((step.stamp_ns - self.start_ns) / 1e6)
        self.state.append(_index(self.states, step.conclusion.state))
        self.plays.append(_index(self.patterns, step.command.pattern.name))
        for name, column in self.measures.items():
            column.append(step.graph.measures.get(name, nan))
        if step.faults or self._open:
            self._record_faults(number, step)

    def _play_until(self, end_ns: int) -> None:
        """Record the amplitudes of the previous command until the next one."""
        if self._command is None:
            return
        stamp_ns = next_change_ns(self._command, self._last_ns)
        while stamp_ns is not None and stamp_ns < end_ns:
            self._record_amplitude(stamp_ns)
            stamp_ns = next_change_ns(self._command, stamp_ns)

    def _record_amplitude(self, stamp_ns: int) -> None:
        if self._command is None:
            return
        amplitude = amplitude_at(self._command, stamp_ns)
        before = self.edge_amplitude[-1] if self.edge_amplitude else 0.0
        if abs(amplitude - before) > 1e-6:
            self.edge_ms.append((stamp_ns - self.start_ns) / 1e6)
            self.edge_amplitude.append(amplitude)

    def _record_faults(self, number: int, step: Step) -> None:
        """Record faults; consecutive steps with the same fault form one span."""
        current = {(fault.where, fault.message) for fault in step.faults}
        self._open = {key: span for key, span in self._open.items() if key in current}
        for where, message in sorted(current):
            span = self._open.get((where, message))
            if span is None:
                span = self._open[where, message] = FaultSpan(number, number, where, message)
                self.faults.append(span)
            span.last = number


def _index(names: list[str], name: str) -> int:
    if name not in names:
        names.append(name)
    return names.index(name)
