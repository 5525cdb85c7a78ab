"""Totals of a batch, added up result by result in little memory."""

from array import array
from collections import Counter, defaultdict
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from haptigraph.analysis.batch.results import Row

__all__ = ["Moment", "Result", "Totals"]

MAX_LISTED = 500
NUMBERS = {
    "replay": (
        *("steps", "identical", "states_differ", "haptics_differ"),
        *("states_differ_s", "haptics_differ_s"),
    ),
    "export": ("bytes",),
}

Moment = tuple[str, int, float, str]
"""Recording, step, time [s], what happened."""
Result = tuple[str, Mapping[str, Any]]
"""Recording, its result."""


class Totals:
    """Totals of all results; `add` them in order.

    Args:
        kind: Of the batch.
    """

    def __init__(self, kind: str) -> None:
        self.kind = kind
        self.recordings = 0
        self.cpu_s = 0.0
        self.problems = list[tuple[str, str]]()
        """Recordings that were passed over, and why: the first of them."""
        self.passed_over = 0
        self.sums: dict[str, float] = defaultdict(int)
        self.tips: dict[str, Counter[str]] = {}
        """Images to score, tips and false tips, by perceiver."""
        self.changed = self.hits_gained = self.hits_lost = 0
        """Recordings with another state or haptic output; with a hit as replayed only; as recorded only."""
        self.gained = self.lost = 0
        self.moments: dict[str, list[Moment]] = {"gained": [], "lost": []}
        self.listed: tuple[list[Result], list[Result]] = ([], [])
        """Recordings that change, and that do not: the first of them, with their results."""
        self.state_changes = [0, 0]
        """Changes of state between start and end, as recorded and as replayed."""
        self.state_s: tuple[Counter[str], Counter[str]] = (Counter(), Counter())
        self.pattern_steps: tuple[Counter[str], Counter[str]] = (Counter(), Counter())
        self.shares = array("d")
        """Share of steps with another state, of each recording."""
        self.values: dict[str, array[float]] = {}
        """Every number of a measure, or every error."""

    def add(self, row: Row) -> None:
        """Add one result."""
        self.cpu_s += row.cpu_s
        if row.problem:
            self.passed_over += 1
            if len(self.problems) < MAX_LISTED:
                self.problems.append((row.recording, row.problem))
            return
        self.recordings += 1
        for name in NUMBERS.get(self.kind, ()):
            self.sums[name] += row.result[name]
        if self.kind == "evaluate":
            tips = self.tips.setdefault(row.result["perceiver"], Counter())
            tips.update({name: row.result[name] for name in ("images", "tips", "false_tips")})
        if self.kind == "replay":
            self._add_replay(row.recording, row.result)
        for name, value in _numbers(self.kind, row.result):
            self.values.setdefault(name, array("d")).append(value)

    def spread(self, name: str) -> tuple[int, float, float, float]:
        """Return number, median, 5th and 95th percentile of a measure."""
        low, median, high = np.percentile(np.asarray(self.values[name]), (5, 50, 95))
        return len(self.values[name]), float(median), float(low), float(high)

    def _add_replay(self, name: str, result: Mapping[str, Any]) -> None:
        is_changed = result["states_differ"] + result["haptics_differ"] > 0
        self.changed += is_changed
        same_kind = self.listed[not is_changed]
        if len(same_kind) < MAX_LISTED:
            same_kind.append((name, result))
        self.shares.append(result["states_differ"] / max(result["steps"], 1))
        for kind in ("gained", "lost"):
            alarms = result[f"alarms_{kind}"]
            setattr(self, kind, getattr(self, kind) + len(alarms))
            for alarm in alarms:
                self._list(kind, (name, alarm["step"], alarm["time_s"], alarm["state"]))
        before, after = result["recorded"], result["replayed"]
        self.hits_gained += before["completion_s"] is None and after["completion_s"] is not None
        self.hits_lost += before["completion_s"] is not None and after["completion_s"] is None
        for at, figures in enumerate((before, after)):
            self.state_s[at].update(figures["state_s"])
            self.pattern_steps[at].update(figures["patterns"])
            self.state_changes[at] += figures["state_changes"]

    def _list(self, kind: str, moment: Moment) -> None:
        if len(self.moments[kind]) < MAX_LISTED:
            self.moments[kind].append(moment)


def _numbers(kind: str, result: Mapping[str, Any]) -> Iterator[tuple[str, float]]:
    """Yield the numbers whose distribution a report shows."""
    if kind == "measure":
        yield from ((name, value) for name, value in result.items() if isinstance(value, int | float))
    if kind == "evaluate":
        perceiver = result["perceiver"]
        yield from ((f"{perceiver}: tip error [mm]", value) for value in result["tip_errors_mm"])
        yield from ((f"{perceiver}: theta error [deg]", value) for value in result["theta_errors_deg"])
