"""What a run amounts to, as the paper measures it: time per state, completion, mean theta, contacts.

A run starts when the tip is first inside the globe and ends at the first Target Hit (paper, section III), or
as its procedure says (`[run]`).
Computed step by step in constant memory, live as well as from recordings.
"""

from collections.abc import Iterable

from msgspec import Struct, field

from haptigraph.analysis.metrics.temporal import Kept, Monitor
from haptigraph.graph import Triplet
from haptigraph.inference.procedure import Procedure
from haptigraph.inference.span import RunSpan
from haptigraph.messages import Step

__all__ = ["RunMeasures", "measure_run"]

LONGEST_ORDER = 10_000


class RunMeasures(Struct):
    """Measures of one run; feed it steps in order with `add`."""

    started_ns: int | None = None
    """When the edge that begins it was first there."""
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
    theta_s: float = 0.0
    theta_integral: float = 0.0
    last: Step | None = None
    last_state: str = ""
    """The last state in which there was an image."""
    span: RunSpan = RunSpan()
    has_start: bool = True
    """Whether the procedure has the edge that begins a run; without it none ever starts."""
    monitors: list[Monitor] = field(default_factory=list)
    first_ns: int = 0
    """Stamp of the first step."""
    just_broken: tuple[str, ...] = ()
    """Claims about time that the last step broke."""

    @classmethod
    def under(cls, procedure: Procedure) -> "RunMeasures":
        """Return empty measures of a run under a procedure."""
        return cls(
            span=procedure.span,
            has_start=procedure.span.is_told_by(procedure.schema),
            monitors=[Monitor(claim) for claim in procedure.temporal],
        )

    @property
    def claims(self) -> list[Kept]:
        """How the procedure's claims about time were kept, over all steps."""
        return [monitor.kept for monitor in self.monitors]

    @property
    def completion_s(self) -> float | None:
        """From start to end; None if it did not end."""
        if self.started_ns is None or self.ended_ns is None:
            return None
        return (self.ended_ns - self.started_ns) / 1e9

    @property
    def mean_theta_deg(self) -> float | None:
        """Mean theta between start and end, weighted by time, where the needle was seen."""
        return self.theta_integral / self.theta_s if self.theta_s > 0 else None

    @property
    def is_running(self) -> bool:
        """Whether the run has started and not ended."""
        return self.started_ns is not None and self.ended_ns is None

    def add(self, step: Step) -> None:
        """Take the next step; a state lasts until the step after it."""
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
        if not any(fault.where == "source" for fault in step.faults):
            self.last_state = state
        self.last = step
        if self.monitors:
            self.just_broken = tuple(one.claim.name for one in self.monitors if one.add(step))

    def _enter(self, state: str) -> None:
        if self.order and self.order[-1] == state:
            return
        if len(self.order) < LONGEST_ORDER:
            self.order.append(state)
        self.contacts += state == self.span.contact_in

    def _account(self, step: Step, lasted_s: float) -> None:
        state = step.conclusion.state
        self.all_state_s[state] = self.all_state_s.get(state, 0.0) + lasted_s
        if self.is_running:
            self.state_s[state] = self.state_s.get(state, 0.0) + lasted_s
            theta_deg = step.graph.measures.get("theta_deg")
            if theta_deg is not None:
                self.theta_s += lasted_s
                self.theta_integral += lasted_s * theta_deg


def measure_run(steps: Iterable[Step]) -> RunMeasures:
    """Measure a whole run."""
    measures = RunMeasures()
    for step in steps:
        measures.add(step)
    return measures
