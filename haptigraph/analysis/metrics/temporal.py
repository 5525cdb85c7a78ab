"""Monitor temporal claims during a run: an alarm in time, a limited number of pattern changes.

Works step by step in constant memory, live and on recordings. A response time ends when the guard received
the pattern, without the device's delay. Steps without timing (replays) use their image stamps.
"""

from collections import deque
from collections.abc import Iterable

from msgspec import Struct

from haptigraph.graph import SceneGraph
from haptigraph.inference.claims import Temporal
from haptigraph.messages import OFF, Step

__all__ = ["ClaimResult", "Monitor", "claim_lines"]


class ClaimResult(Struct):
    """How one claim held during a run."""

    name: str
    unit: str
    """Unit of `most`: "ms" until the pattern was commanded, or pattern "changes" in the claim's window."""
    cases: int = 0
    """How often its premise became true, or the pattern changed."""
    broken: int = 0
    first_broken_ns: int | None = None
    most: float = 0.0
    """The worst value."""


class Monitor:
    """Monitor one claim during one run.

    Args:
        claim: A temporal claim of a checked procedure.
    """

    def __init__(self, claim: Temporal) -> None:
        self.claim = claim
        self.result = ClaimResult(claim.name, "changes" if claim.within_ms is None else "ms")
        self._since_ns: int | None = None
        """When the premise became true; None while it is false."""
        self._is_settled = self._is_over = False
        self._pattern = ""
        self._changes_ns: deque[int] = deque()

    def add(self, step: Step) -> bool:
        """Process the next step; return whether it breaks the claim."""
        if self.claim.within_ms is None:
            is_broken = self._changes_too_often(step)
        else:
            is_broken = self._response_is_late(step, self.claim.within_ms)
        if is_broken:
            self.result.broken += 1
            if self.result.first_broken_ns is None:
                self.result.first_broken_ns = step.stamp_ns
        self._pattern = step.command.pattern.name
        return is_broken

    def _response_is_late(self, step: Step, within_ms: float) -> bool:
        """Return whether the deadline passes with this step; once for each time the premise becomes true."""
        if not _premise_holds(self.claim, step.graph):
            self._since_ns = None
            return False
        if self._since_ns is None:
            self._since_ns, self._is_settled = step.stamp_ns, False
            self.result.cases += 1
        if self._is_settled:
            return False
        is_commanded = step.command.pattern.name in self.claim.feels
        commanded_ns = step.stamp_ns if step.timing is None else step.timing.commanded_ns
        delay_ms = ((commanded_ns if is_commanded else step.stamp_ns) - self._since_ns) / 1e6
        if is_commanded and (self._pattern or OFF.name) in self.claim.feels:
            delay_ms = 0.0  # the pattern was already playing; before the first step there is silence
        self.result.most = max(self.result.most, delay_ms)
        self._is_settled = is_commanded or delay_ms > within_ms
        return delay_ms > within_ms

    def _changes_too_often(self, step: Step) -> bool:
        """Return whether the number of pattern changes exceeds the limit with this step."""
        if self._pattern and step.command.pattern.name != self._pattern:
            self._changes_ns.append(step.stamp_ns)
            self.result.cases += 1
        while self._changes_ns and step.stamp_ns - self._changes_ns[0] >= self.claim.in_ms * 1e6:
            self._changes_ns.popleft()
        count, was_over = len(self._changes_ns), self._is_over
        self.result.most = max(self.result.most, count)
        self._is_over = self.claim.most_changes is not None and count > self.claim.most_changes
        return self._is_over and not was_over


def claim_lines(results: Iterable[ClaimResult], start_ns: int) -> list[str]:
    """Return one line of text per claim; times are relative to `start_ns`."""
    lines = []
    for result in results:
        worst = f"at most {result.most:.3g} {result.unit}"
        if result.first_broken_ns is not None:
            at_s = (result.first_broken_ns - start_ns) / 1e9
            outcome = f"BROKEN {result.broken} x, first at {at_s:.2f} s, {worst}"
        else:
            outcome = f"kept, {worst}" if result.cases else "not exercised"
        lines.append(f"claim           {result.name}: {outcome}")
    return lines


def _premise_holds(claim: Temporal, graph: SceneGraph) -> bool:
    category = {node.id: node.category for node in graph.nodes}
    edges = {(category[edge.subject], edge.predicate, category[edge.object]) for edge in graph.edges}
    present = set(category.values())
    return (
        edges.issuperset(claim.when)
        and edges.isdisjoint(claim.unless)
        and present.issuperset(claim.present)
        and present.isdisjoint(claim.absent)
    )
