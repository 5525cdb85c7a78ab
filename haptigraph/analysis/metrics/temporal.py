"""Claims about time, watched while a run goes on: an alarm soon enough, not too many changes of touch.

Fed step by step in constant memory, live as well as from recordings. A pattern counts as felt when it was
handed to the guard: what device and skin add is not in it. Steps without timing (replays) go by their images.
"""

from collections import deque
from collections.abc import Iterable

from msgspec import Struct

from haptigraph.graph import SceneGraph
from haptigraph.inference.claims import Temporal
from haptigraph.messages import Step

__all__ = ["Kept", "Monitor", "claim_lines"]


class Kept(Struct):
    """How a run kept one claim."""

    name: str
    unit: str
    """Of `most`: "ms" until the touch was felt, or "changes" of touch in the time the claim says."""
    cases: int = 0
    """How often its first part came true; how often touch changed."""
    broken: int = 0
    first_broken_ns: int | None = None
    most: float = 0.0
    """The worst that was seen."""


class Monitor:
    """Watch one claim over one run.

    Args:
        claim: Of a checked procedure.
    """

    def __init__(self, claim: Temporal) -> None:
        self.claim = claim
        self.kept = Kept(claim.name, "changes" if claim.within_ms is None else "ms")
        self._since_ns: int | None = None
        """When the first part came true; None while it is not."""
        self._is_settled = self._is_over = False
        self._pattern = ""
        self._changes_ns: deque[int] = deque()

    def add(self, step: Step) -> bool:
        """Take the next step; True if the claim broke just now."""
        if self.claim.within_ms is None:
            is_broken = self._changed_too_often(step)
        else:
            is_broken = self._felt_too_late(step, self.claim.within_ms)
        if is_broken:
            self.kept.broken += 1
            if self.kept.first_broken_ns is None:
                self.kept.first_broken_ns = step.stamp_ns
        self._pattern = step.command.pattern.name
        return is_broken

    def _felt_too_late(self, step: Step, within_ms: float) -> bool:
        """Tell whether the time ran out just now; once for each time that the first part came true."""
        if not _fits(self.claim, step.graph):
            self._since_ns = None
            return False
        if self._since_ns is None:
            self._since_ns, self._is_settled = step.stamp_ns, False
            self.kept.cases += 1
        if self._is_settled:
            return False
        is_felt = step.command.pattern.name in self.claim.feels
        handed_ns = step.stamp_ns if step.timing is None else step.timing.commanded_ns
        waited_ms = ((handed_ns if is_felt else step.stamp_ns) - self._since_ns) / 1e6
        if is_felt and self._pattern in self.claim.feels:
            waited_ms = 0.0  # it was felt already
        self.kept.most = max(self.kept.most, waited_ms)
        self._is_settled = is_felt or waited_ms > within_ms
        return waited_ms > within_ms

    def _changed_too_often(self, step: Step) -> bool:
        """Tell whether touch has just begun to change too often."""
        if self._pattern and step.command.pattern.name != self._pattern:
            self._changes_ns.append(step.stamp_ns)
            self.kept.cases += 1
        while self._changes_ns and step.stamp_ns - self._changes_ns[0] >= self.claim.in_ms * 1e6:
            self._changes_ns.popleft()
        count, was_over = len(self._changes_ns), self._is_over
        self.kept.most = max(self.kept.most, count)
        self._is_over = self.claim.most_changes is not None and count > self.claim.most_changes
        return self._is_over and not was_over


def claim_lines(kept: Iterable[Kept], start_ns: int) -> list[str]:
    """Say of each claim how it was kept; moments from `start_ns` on."""
    lines = []
    for one in kept:
        worst = f"at most {one.most:.3g} {one.unit}"
        if one.first_broken_ns is not None:
            at_s = (one.first_broken_ns - start_ns) / 1e9
            told = f"BROKEN {one.broken} x, first at {at_s:.2f} s, {worst}"
        else:
            told = f"kept, {worst}" if one.cases else "kept, never put to the test"
        lines.append(f"claim           {one.name}: {told}")
    return lines


def _fits(claim: Temporal, graph: SceneGraph) -> bool:
    category = {node.id: node.category for node in graph.nodes}
    edges = {(category[edge.subject], edge.predicate, category[edge.object]) for edge in graph.edges}
    there = set(category.values())
    return (
        edges.issuperset(claim.when)
        and edges.isdisjoint(claim.unless)
        and there.issuperset(claim.present)
        and there.isdisjoint(claim.absent)
    )
