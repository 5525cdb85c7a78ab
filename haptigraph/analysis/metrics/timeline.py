"""A run as columns, small enough to be drawn whole: when, which state, which measures, what the hand felt.

Fed step by step; keeps about 40 bytes of each, and no image.
"""

from array import array
from collections.abc import Iterable
from math import nan

from msgspec import Struct

from haptigraph.haptics.pattern import amplitude_at, next_change_ns
from haptigraph.messages import HapticCommand, Step

__all__ = ["FaultSpan", "Timeline"]


class FaultSpan(Struct):
    """A fault, and the steps it went on for."""

    first: int
    last: int
    where: str
    message: str


class Timeline:
    """Columns of one run.

    Args:
        states: Names that states are told by; others are added as they come.
        measures: Names of the measures to keep.
    """

    def __init__(self, states: Iterable[str], measures: Iterable[str]) -> None:
        self.states = list(states)
        self.patterns: list[str] = []
        self.time_ms = array("d")
        """Since the first step."""
        self.state = array("H")
        """Place in `states`."""
        self.plays = array("H")
        """Place in `patterns` of what is commanded."""
        self.measures = {name: array("f") for name in measures}
        """nan where there is none."""
        self.edge_ms = array("d")
        """When the amplitude of the touch changes, as commanded: the guard may have felt otherwise."""
        self.edge_amplitude = array("f")
        self.faults: list[FaultSpan] = []
        self.start_ns = 0
        self._last_ns = 0
        self._command: HapticCommand | None = None
        self._open: dict[tuple[str, str], FaultSpan] = {}

    def __len__(self) -> int:
        return len(self.time_ms)

    def add(self, step: Step) -> None:
        """Take the next step."""
        number = len(self)
        if not number:
            self.start_ns = step.stamp_ns
        self._feel_until(step.stamp_ns)
        self._command, self._last_ns = step.command, step.stamp_ns
        self._feel(step.stamp_ns)
        self.time_ms.append((step.stamp_ns - self.start_ns) / 1e6)
        self.state.append(_place(self.states, step.conclusion.state))
        self.plays.append(_place(self.patterns, step.command.pattern.name))
        for name, column in self.measures.items():
            column.append(step.graph.measures.get(name, nan))
        if step.faults or self._open:
            self._note_faults(number, step)

    def _feel_until(self, end_ns: int) -> None:
        """Play the command before up to the next."""
        if self._command is None:
            return
        stamp_ns = next_change_ns(self._command, self._last_ns)
        while stamp_ns is not None and stamp_ns < end_ns:
            self._feel(stamp_ns)
            stamp_ns = next_change_ns(self._command, stamp_ns)

    def _feel(self, stamp_ns: int) -> None:
        if self._command is None:
            return
        amplitude = amplitude_at(self._command, stamp_ns)
        before = self.edge_amplitude[-1] if self.edge_amplitude else 0.0
        if abs(amplitude - before) > 1e-6:
            self.edge_ms.append((stamp_ns - self.start_ns) / 1e6)
            self.edge_amplitude.append(amplitude)

    def _note_faults(self, number: int, step: Step) -> None:
        """Note faults; one that goes on is one."""
        now = {(fault.where, fault.message) for fault in step.faults}
        self._open = {key: span for key, span in self._open.items() if key in now}
        for where, message in sorted(now):
            span = self._open.get((where, message))
            if span is None:
                span = self._open[where, message] = FaultSpan(number, number, where, message)
                self.faults.append(span)
            span.last = number


def _place(names: list[str], name: str) -> int:
    if name not in names:
        names.append(name)
    return names.index(name)
