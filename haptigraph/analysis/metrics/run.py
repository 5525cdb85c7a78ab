"""Measures of a run as in the paper: time per state, completion time, mean theta, contacts.

A run starts when the tip is first inside the globe and ends at the first Target Hit (paper, section III), or
as its procedure defines (`[run]`). Computed step by step in constant memory, live and from recordings.
"""

from collections.abc import Iterable

from msgspec import Struct, field

from haptigraph.analysis.metrics.in_space import InSpace
from haptigraph.analysis.metrics.temporal import ClaimResult, Monitor
from haptigraph.graph import Triplet
from haptigraph.haptics.pattern import vibrating_ns
from haptigraph.inference.procedure import Procedure
from haptigraph.inference.span import RunSpan
from haptigraph.messages import TIP_NOT_VISIBLE, Step

__all__ = ["RunMeasures", "measure_run"]

MAX_ORDER = 10_000


class RunMeasures(Struct):
    """Measures of one run; `add` its steps in order."""

    started_ns: int | None = None
    """When the edge that starts it first appeared."""
    ended_ns: int | None = None
    """When the state that ends it was first entered."""
    state_s: dict[str, float] = field(default_factory=dict)
    """Time in each state between start and end."""
    all_state_s: dict[str, float] = field(default_factory=dict)
    """Time in each state over all steps."""
    order: list[str] = field(default_factory=list)
    """States in the order they were traversed between start and end."""
    contacts: int = 0
    """How often the state of unintended contact was entered between start and end."""
    vibrating_s: dict[str, float] = field(default_factory=dict)
    """Time with a commanded amplitude above 0 over all steps, by pattern."""
    theta_s: float = 0.0
    theta_integral: float = 0.0
    last: Step | None = None
    span: RunSpan = RunSpan()
    has_start: bool = True
    """Whether the procedure defines the edge that starts a run; without it no run ever starts."""
    monitors: list[Monitor] = field(default_factory=list)
    first_ns: int = 0
    """Stamp of the first step."""
    steps: int = 0
    tipless_steps: int = 0
    """Of a needle without a visible tip."""
    longest_tipless_s: float = 0.0
    """Longest time without a visible tip."""
    tipless_since_ns: int | None = None
    """Since when the tip is not visible; None if it is, or no needle is detected."""
    just_broken: tuple[str, ...] = ()
    """Temporal claims that the last step broke."""
    in_space: InSpace = field(default_factory=InSpace)

    @classmethod
    def under(cls, procedure: Procedure) -> "RunMeasures":
        """Return empty measures for a run of a procedure."""
        return cls(
            span=procedure.span,
            has_start=procedure.span.is_defined_in(procedure.schema),
            monitors=[Monitor(claim) for claim in procedure.temporal],
        )

    @property
    def claims(self) -> list[ClaimResult]:
        """Results of the procedure's temporal claims, over all steps."""
        return [monitor.result for monitor in self.monitors]

    @property
    def state_changes(self) -> int:
        """How often the state changed between start and end."""
        return max(len(self.order) - 1, 0)

    @property
    def completion_s(self) -> float | None:
        """Time from start to end; None if the run did not end."""
        if self.started_ns is None or self.ended_ns is None:
            return None
        return (self.ended_ns - self.started_ns) / 1e9

    @property
    def mean_theta_deg(self) -> float | None:
        """Time-weighted mean of theta between start and end, where the needle was detected."""
        return self.theta_integral / self.theta_s if self.theta_s > 0 else None

    @property
    def is_running(self) -> bool:
        """Whether the run has started and not ended."""
        return self.started_ns is not None and self.ended_ns is None

    def add(self, step: Step) -> None:
        """Process the next step; a state lasts until the following step."""
        if self.last is None:
            self.first_ns = step.stamp_ns
        else:
            self._account(self.last, (step.stamp_ns - self.last.stamp_ns) / 1e9)
        if self.started_ns is None and Triplet(*self.span.begins) in step.graph:
            self.started_ns = step.stamp_ns
        state = step.conclusion.state
        if self.is_running:
            self._enter(state)
        if self.is_running and state == self.span.ends_in:
            self.ended_ns = step.stamp_ns
        self._count_tipless(step)
        self.in_space.add(step.observation)
        self.last = step
        if self.monitors:
            self.just_broken = tuple(monitor.claim.name for monitor in self.monitors if monitor.add(step))

    def _count_tipless(self, step: Step) -> None:
        self.steps += 1
        if self.tipless_since_ns is not None:
            lasted_s = (step.stamp_ns - self.tipless_since_ns) / 1e9
            self.longest_tipless_s = max(self.longest_tipless_s, lasted_s)
        if step.conclusion.state != TIP_NOT_VISIBLE:
            self.tipless_since_ns = None
            return
        self.tipless_steps += 1
        if self.tipless_since_ns is None:
            self.tipless_since_ns = step.stamp_ns

    def _enter(self, state: str) -> None:
        if self.order and self.order[-1] == state:
            return
        if len(self.order) < MAX_ORDER:
            self.order.append(state)
        self.contacts += state == self.span.contact_in

    def _account(self, step: Step, duration_s: float) -> None:
        state = step.conclusion.state
        self.all_state_s[state] = self.all_state_s.get(state, 0.0) + duration_s
        command, until_ns = step.command, step.stamp_ns + round(duration_s * 1e9)
        if on_ns := vibrating_ns(command, step.stamp_ns, until_ns):
            pattern = command.pattern.name
            self.vibrating_s[pattern] = self.vibrating_s.get(pattern, 0.0) + on_ns / 1e9
        if self.is_running:
            self.state_s[state] = self.state_s.get(state, 0.0) + duration_s
            theta_deg = step.graph.measures.get("theta_deg")
            if theta_deg is not None:
                self.theta_s += duration_s
                self.theta_integral += duration_s * theta_deg


def measure_run(steps: Iterable[Step]) -> RunMeasures:
    """Measure a whole run."""
    measures = RunMeasures()
    for step in steps:
        measures.add(step)
    return measures
