"""Find the smallest change from one graph to every other state, in edges and in millimetres.

The relations of the next image follow from the same cells as in proofs, including `release`: a relation that
holds now ends at its release, one that does not begins at its bound.
"""

from collections.abc import Iterable, Iterator, Mapping
from itertools import combinations, product
from math import inf

from msgspec import Struct

from haptigraph.graph import SceneGraph, Triplet
from haptigraph.inference.procedure import Procedure
from haptigraph.messages import UNKNOWN
from haptigraph.proof.intervals import Interval
from haptigraph.proof.motion.search import Motion
from haptigraph.proof.rules import Cube, rule_cubes
from haptigraph.proof.scales import Scale, bits_of
from haptigraph.proof.space import Space

__all__ = ["Change", "Move", "Nearest"]

MAX_MOVES = 3
"""Measures that may change at once; states that need more are not near."""

MM_PER_DEG = 0.42
"""How far a rotation of 1 degree moves a tip 24 mm (the diameter of the eye) from the trocar."""


class Move(Struct, frozen=True):
    """One measure that would have to change."""

    measure: str
    to: str
    """The condition that it would have to satisfy: "theta_deg <= 1.7"."""
    value: float | None
    """Its current value; None if it is undefined."""
    way: float | None
    """Offset to the nearer bound of the condition, in the unit of the measure."""


class Change(Struct, frozen=True):
    """The smallest change that leads to another state."""

    state: str
    feel: str
    priority: int
    moves: tuple[Move, ...]
    appear: tuple[str, ...]
    """Edges and entities that appear."""
    vanish: tuple[str, ...]
    """Edges and entities that vanish."""
    fits_already: bool
    """Whether its rule matches already, and only an earlier rule prevents it from firing."""
    motions: tuple[Motion, ...] = ()
    """Motions of the needle that lead there, the advised one first; then `moves` is empty."""


class _Option(Struct, frozen=True):
    """A possible next interval of one measure, and the relations that would hold there."""

    interval: Interval
    mask: int


class _Successor(Struct, frozen=True):
    """A graph that may follow."""

    graph: int
    present: int
    kept: int
    """Relations of the measures that do not change, regardless of `given`."""
    options: dict[int, _Option]
    """By scale: the next interval of each measure that changes or becomes defined."""


class Nearest:
    """Find the states that are near a graph.

    Args:
        procedure: A checked procedure.
        sds: Standard deviations of measures, as a graph carries them; they do not change.
    """

    def __init__(self, procedure: Procedure, sds: Mapping[str, float] | None = None) -> None:
        self._procedure = procedure
        self._space = Space(procedure.schema.widened(sds or {}))
        self._rules: list[Cube] = rule_cubes(procedure, self._space)

    def changes(self, mask: int, measures: dict[str, float]) -> list[Change]:
        """Return the smallest change to every other reachable state, nearest first.

        Changes are ordered by the sets of entities that appear or vanish, then by the number of measures that
        change, then by the total offset (degrees count as the mm by which they move the tip), then by edges.

        Args:
            mask: The current graph, as bits.
            measures: Its measures.
        """
        now = self._name(self._first_match(mask))
        best: dict[str, tuple[tuple[float, ...], int, _Successor]] = {}
        for present in self._entity_sets(mask):
            lost = bool((present ^ mask) & self._space.visible & ~self._space.edges)
            for cost, successor in self._successors(mask, present, measures):
                rule = self._first_match(successor.graph)
                state, key = self._name(rule), (float(lost), *cost, float(rule))
                if state != now and (state not in best or key < best[state][0]):
                    best[state] = key, rule, successor
        nearest = sorted(best.values(), key=lambda found: found[0])
        return [self._change(rule, mask, successor, measures) for _, rule, successor in nearest]

    def _first_match(self, mask: int) -> int:
        """Return the index of the first rule that matches; the number of rules if none does."""
        return next((at for at, rule in enumerate(self._rules) if rule.matches(mask)), len(self._rules))

    def _bit_names(self, mask: int) -> list[str]:
        """Return the names of the edges and entities of some bits."""
        schema = self._procedure.schema
        names = [str(Triplet(*relation.names)) for relation in schema.relations]
        names += [entity.name for entity in schema.entities]
        return [names[bit] for bit in bits_of(mask & self._space.visible)]

    def mask(self, graph: SceneGraph) -> int:
        """Return a scene graph as bits."""
        return self._space.mask(graph)

    def _entity_sets(self, mask: int) -> Iterator[int]:
        """Yield sets of entities: the current one, all, and the current one with one cluster toggled.

        Where there are no entities, the toggled set is that of the fixed ones.
        """
        space = self._space
        undeclared = sum(space.entity_bits[name] for name in space.undeclared)
        here = mask & ~space.edges | undeclared
        clusters = [cluster for cluster in space.clusters if not cluster & undeclared]
        yield here
        yield space.fixed | undeclared | sum(clusters)
        if not here & ~undeclared:
            yield from (space.toggled(space.fixed, cluster) | undeclared for cluster in space.clusters)
        else:
            yield from (space.toggled(here, cluster) for cluster in clusters)

    def _successors(
        self, mask: int, present: int, measures: dict[str, float]
    ) -> Iterator[tuple[tuple[float, ...], _Successor]]:
        """Yield graphs that may follow, and their cost: measures that change, their total offset, edges."""
        space = self._space
        held = mask & space.edges
        defined = [at for at, is_defined in enumerate(space.measured(present)) if is_defined]
        new = [at for at in defined if space.scales[at].name not in measures]
        free = [at for at in defined if at not in new]
        options = {at: _options(space.scales[at], held, measures) for at in defined}
        staying = {at: space.scales[at].cell_at(measures[space.scales[at].name]).after(held) for at in free}
        for count in range(min(len(free), MAX_MOVES) + 1):
            for moving in combinations(free, count):
                kept = sum(staying[at] for at in free if at not in moving)
                for chosen in product(*(options[at] for at in (*new, *moving))):
                    by_scale = dict(zip((*new, *moving), chosen, strict=True))
                    if self._is_consistent(by_scale, measures):
                        graph = present | space.close(kept | _sum(chosen))
                        edges = ((graph ^ mask) & space.edges).bit_count()
                        offset = sum(_offset(space.scales[at], one, measures) for at, one in by_scale.items())
                        yield (float(count), offset, float(edges)), _Successor(graph, present, kept, by_scale)

    def _is_consistent(self, options: dict[int, _Option], measures: dict[str, float]) -> bool:
        """Return whether the geometric limits allow these intervals, together with the unchanged measures."""
        scales = self._space.scales
        for small, large in self._space.never_above.items():
            intervals = []
            for number in (small, large):
                value = measures.get(scales[number].name)
                unchanged = None if value is None else Interval(value, value, True, True)
                intervals.append(options[number].interval if number in options else unchanged)
            lower, upper = intervals
            if lower is not None and upper is not None and not lower.can_be_at_most(upper):
                return False
        return True

    def _change(self, rule: int, mask: int, successor: _Successor, measures: dict[str, float]) -> Change:
        states = self._procedure.states
        state = next(one for one in states if one.name == self._name(rule))
        moves = []
        needed = self._needed(rule, successor, measures)
        for at in needed:
            name, interval = self._space.scales[at].name, successor.options[at].interval
            now = measures.get(name)
            offset = None if now is None else interval.offset_from(now)
            moves.append(Move(name, self._condition(at, interval), now, offset))
        free = successor.options.keys() - set(needed)
        open_edges = sum(self._space.scales[at].bits for at in free)  # may or may not hold
        return Change(
            state=state.name,
            feel=state.feel,
            priority=rule,
            moves=tuple(moves),
            appear=tuple(self._bit_names(successor.graph & ~mask & ~open_edges)),
            vanish=tuple(self._bit_names(mask & ~successor.graph)),
            fits_already=rule < len(states) and self._rules[rule].matches(mask),
        )

    def _condition(self, at: int, interval: Interval) -> str:
        """Return the condition on a measure, without its geometric limits."""
        scale = self._space.scales[at]
        low = -inf if interval.low == scale.limits.lower else interval.low
        high = inf if interval.high == scale.limits.upper else interval.high
        return Interval(low, high, interval.has_low, interval.has_high).describe(scale.name)

    def _needed(self, rule: int, successor: _Successor, measures: dict[str, float]) -> list[int]:
        """Return the measures whose interval matters; that of a newly defined measure may not."""
        space, free = self._space, list[int]()
        for at in successor.options:
            trial = [*free, at]
            fixed = _sum(option for other, option in successor.options.items() if other not in trial)
            choices = product(*(_options(space.scales[other], 0, {}) for other in trial))
            graphs = (space.close(successor.kept | fixed | _sum(chosen)) for chosen in choices)
            if space.scales[at].name not in measures and all(
                self._first_match(successor.present | graph) == rule for graph in graphs
            ):
                free = trial
        return sorted(at for at in successor.options if at not in free)

    def _name(self, rule: int) -> str:
        states = self._procedure.states
        return UNKNOWN if rule == len(states) else states[rule].name


def _options(scale: Scale, held: int, measures: dict[str, float]) -> list[_Option]:
    """Return the intervals to which a measure may change, merged where the same relations would hold."""
    options: list[_Option] = []
    now = measures.get(scale.name)
    for cell in scale.cells:
        option = _Option(cell.interval, cell.after(held))
        if options and options[-1].mask == option.mask:
            option = _Option(options.pop().interval.union(option.interval), option.mask)
        options.append(option)
    return [one for one in options if now is None or now not in one.interval]


def _sum(chosen: Iterable[_Option]) -> int:
    """Return all relations that would hold."""
    return sum(one.mask for one in chosen)


def _offset(scale: Scale, option: _Option, measures: dict[str, float]) -> float:
    """Return how far a measure changes [mm]; degrees count as the mm by which they move the tip."""
    now = measures.get(scale.name)
    offset = 0.0 if now is None else abs(option.interval.offset_from(now))
    return offset * MM_PER_DEG if scale.measure.endswith("_deg") else offset
