"""A run as columns for drawing: time, state, measures, commanded amplitude.

Built step by step; stores about 40 bytes per step, and no images.
"""

from array import array
from collections.abc import Iterable
from math import nan

from msgspec import Struct

from haptigraph.haptics.pattern import amplitude_at, next_change_ns
from haptigraph.messages import HapticCommand, Step

__all__ = ["FaultSpan", "FaultSpans", "Timeline"]

LASTING = ("device",)
"""Parts whose fault is reported once, and then that it is over."""


class FaultSpan(Struct):
    """A fault, and the steps it lasted."""

    first: int
    last: int
    where: str
    message: str
    ended: str = ""
    """How it ended, as far as the next step reports it: "responds again"."""


class FaultSpans:
    """The faults of a run, and how long each lasted.

    Consecutive steps with the same fault form one span. A fault of a haptic device is reported once; it lasts
    until the device responds again, or else to the end.
    """

    def __init__(self) -> None:
        self.all: list[FaultSpan] = []
        self.open: list[FaultSpan] = []
        """Those of the newest step."""

    def add(self, number: int, step: Step) -> None:
        """Take the next step."""
        reported = step.observation.faults
        if not reported and not self.open:
            return
        current = {(fault.where, fault.message) for fault in step.faults}
        lasting = [
            span for span in self.open if span.where in LASTING or (span.where, span.message) in current
        ]
        for fault in reported:
            same = [span for span in lasting if span.where == fault.where]
            if fault.is_over:
                for span in same:
                    span.ended = fault.message
                lasting = [span for span in lasting if span not in same]
            elif fault.message not in [span.message for span in same]:
                lasting.append(FaultSpan(number, number, fault.where, fault.message))
                self.all.append(lasting[-1])
        self.open = lasting
        for span in lasting:
            span.last = number


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
        self._faults = FaultSpans()
        self.start_ns = 0
        self._last_ns = 0
        self._command: HapticCommand | None = None

    def __len__(self) -> int:
        return len(self.time_ms)

    @property
    def faults(self) -> list[FaultSpan]:
        """Faults, in the order in which they began."""
        return self._faults.all

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
        self._faults.add(number, step)

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


def _index(names: list[str], name: str) -> int:
    if name not in names:
        names.append(name)
    return names.index(name)
