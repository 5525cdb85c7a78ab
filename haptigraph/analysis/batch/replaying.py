"""What a replay changed in one recording: alarms gained and lost, other states, and figures to compare."""

from collections import Counter
from collections.abc import Mapping
from typing import Any

from msgspec import Struct, to_builtins

from haptigraph.analysis.metrics.run import RunMeasures
from haptigraph.inference.meaning import Kind
from haptigraph.messages import Step

__all__ = ["Moments", "figures"]

MAX_CHANGES = 20  # of a recording, listed one by one


class _Alarm(Struct):
    """Consecutive steps in states of the kind alarm."""

    step: int
    time_s: float
    state: str
    last: int
    is_shared: bool = False
    """Whether the other run has an alarm in one of these steps."""


class _Change(Struct):
    """Consecutive steps whose state is another one, in the same way."""

    step: int
    time_s: float
    recorded: str
    replayed: str
    steps: int = 1


class Moments:
    """Compare two runs of the same images, step by step.

    An alarm is gained if it is in the replayed run and none of its steps is one of an alarm in the recorded
    run; lost, the other way round.

    Args:
        recorded: Kinds of the recorded procedure's states.
        replayed: Kinds of the applied procedure's states.
    """

    def __init__(self, recorded: Mapping[str, Kind], replayed: Mapping[str, Kind]) -> None:
        self._kinds = recorded, replayed
        self._alarms: tuple[list[_Alarm], list[_Alarm]] = ([], [])
        self._changes = list[_Change]()
        self._open: _Change | None = None
        self._count = self._start_ns = self._changed = 0

    def add(self, recorded: Step, replayed: Step) -> None:
        """Add the next step of both."""
        self._start_ns = self._start_ns if self._count else recorded.stamp_ns
        time_s = (recorded.stamp_ns - self._start_ns) / 1e9
        states = recorded.conclusion.state, replayed.conclusion.state
        are_alarms = [kinds.get(state) == "alarm" for kinds, state in zip(self._kinds, states, strict=True)]
        for alarms, state, is_alarm in zip(self._alarms, states, are_alarms, strict=True):
            if is_alarm:
                if not alarms or alarms[-1].last != self._count - 1:
                    alarms.append(_Alarm(self._count, time_s, state, self._count))
                alarms[-1].last = self._count
                alarms[-1].is_shared |= all(are_alarms)
        self._note_change(time_s, *states)
        self._count += 1

    def found(self) -> dict[str, Any]:
        """Return what was gained, lost and changed."""
        lost, gained = (
            [{"step": a.step, "time_s": a.time_s, "state": a.state} for a in alarms if not a.is_shared]
            for alarms in self._alarms
        )
        return {
            "alarms_gained": gained,
            "alarms_lost": lost,
            "changes": to_builtins(self._changes),
            "changes_left_out": self._changed - len(self._changes),
        }

    def _note_change(self, time_s: float, recorded: str, replayed: str) -> None:
        change = self._open
        if recorded == replayed:
            self._open = None
        elif change is not None and (change.recorded, change.replayed) == (recorded, replayed):
            change.steps += 1
        else:
            self._open = _Change(self._count, time_s, recorded, replayed)
            self._changed += 1
            if len(self._changes) < MAX_CHANGES:
                self._changes.append(self._open)


def figures(measures: RunMeasures, patterns: Counter[str]) -> dict[str, Any]:
    """Return the figures of a run that a report compares."""
    return {
        "completion_s": measures.completion_s,
        "mean_theta_deg": measures.mean_theta_deg,
        "contacts": measures.contacts,
        "state_changes": measures.state_changes,
        "broken_claims": sum(claim.broken for claim in measures.claims),
        "state_s": measures.all_state_s,
        "patterns": dict(patterns),
    }
