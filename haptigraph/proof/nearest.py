"""From one graph to every other state: the smallest change that leads there, in edges and in millimetres.

What would hold in the next image is asked of the same cells that proofs use, `release` included: a relation
that holds now is left at its release, one that does not is entered at its bound.
"""

from collections.abc import Iterable, Iterator
from itertools import combinations, product
from math import inf

from msgspec import Struct

from haptigraph.graph import SceneGraph, Triplet
from haptigraph.inference.procedure import Procedure
from haptigraph.messages import UNKNOWN
from haptigraph.proof.intervals import Interval
from haptigraph.proof.rules import Cube, cubes_of
from haptigraph.proof.scales import Scale, bits_of
from haptigraph.proof.space import Space

__all__ = ["Change", "Move", "Nearest"]

MOST_MOVES = 3
"""Measures that may move at once; states that need more are not near."""

MM_PER_DEG = 0.42
"""What a degree moves a tip 24 mm from the trocar, an eye's diameter."""


class Move(Struct, frozen=True):
    """One measure that would have to lie elsewhere."""

    measure: str
    to: str
    """Where: "theta_deg <= 1.7"."""
    value: float | None
    """What it is now; None where there is no such measure yet."""
    way: float | None
    """How far to the edge of it, in the unit of the measure."""


class Change(Struct, frozen=True):
    """The smallest change after which another state holds."""

    state: str
    feel: str
    priority: int
    moves: tuple[Move, ...]
    appear: tuple[str, ...]
    """Edges and entities that come."""
    vanish: tuple[str, ...]
    """Edges and entities that go."""
    fits_already: bool
    """Whether its rule fits as it is, and only an earlier one keeps it from firing."""


class _Option(Struct, frozen=True):
    """Where one measure may lie next, and what would hold there."""

    interval: Interval
    mask: int


class _Next(Struct, frozen=True):
    """A graph that may follow."""

    graph: int
    present: int
    kept: int
    """Relations of the measures that stay, `given` left aside."""
    places: dict[int, _Option]
    """By scale: where the measures that move, or are new, come to lie."""


class Nearest:
    """Find what is near to a graph.

    Args:
        procedure: A checked procedure.
    """

    def __init__(self, procedure: Procedure) -> None:
        self._procedure = procedure
        self._space = Space(procedure.schema)
        self._rules: list[Cube] = cubes_of(procedure, self._space)

    def changes(self, mask: int, measures: dict[str, float]) -> list[Change]:
        """Return the smallest change to every other state that can be reached, nearest first.

        The smallest: fewest sets of entities that come or go, then fewest measures that move, then the
        shortest way, then fewest edges. On the way, degrees count as the mm by which they move the tip.

        Args:
            mask: The graph now, as bits.
            measures: Its measures.
        """
        now = self._name(self.fired(mask))
        best: dict[str, tuple[tuple[float, ...], int, _Next]] = {}
        for present in self._presences(mask):
            lost = bool((present ^ mask) & self._space.visible & ~self._space.edges)
            for cost, following in self._reachable(mask, present, measures):
                fired = self.fired(following.graph)
                state, key = self._name(fired), (float(lost), *cost, float(fired))
                if state != now and (state not in best or key < best[state][0]):
                    best[state] = key, fired, following
        nearest = sorted(best.values(), key=lambda found: found[0])
        return [self._change(fired, mask, following, measures) for _, fired, following in nearest]

    def fired(self, mask: int) -> int:
        """Return the number of the first rule that fits; the number of rules if none does."""
        return next((at for at, rule in enumerate(self._rules) if rule.fits(mask)), len(self._rules))

    def bits(self, mask: int) -> list[str]:
        """Name the edges and entities of some bits."""
        schema = self._procedure.schema
        names = [str(Triplet(*relation.names)) for relation in schema.relations]
        names += [entity.name for entity in schema.entities]
        return [names[bit] for bit in bits_of(mask & self._space.visible)]

    def mask(self, graph: SceneGraph) -> int:
        """Return a scene graph as bits."""
        return self._space.mask(graph)

    def _presences(self, mask: int) -> Iterator[int]:
        """Yield who is there: as now, everyone, and one set of entities more or less."""
        space = self._space
        unnamed = sum(space.entity_bits[name] for name in space.unnamed)
        here = mask & ~space.edges | unnamed
        yield here
        yield space.fixed | unnamed | sum(cluster for cluster in space.clusters if not cluster & unnamed)
        if not here & ~unnamed:
            yield from (space.fixed | cluster | unnamed for cluster in space.clusters)
        else:
            yield from (here ^ cluster for cluster in space.clusters if not cluster & unnamed)

    def _reachable(
        self, mask: int, present: int, measures: dict[str, float]
    ) -> Iterator[tuple[tuple[float, ...], _Next]]:
        """Yield graphs that can follow, and what they cost: measures that move, their way, edges."""
        space = self._space
        held = mask & space.edges
        there = [at for at, here in enumerate(space.measured(present)) if here]
        new = [at for at in there if space.scales[at].name not in measures]
        free = [at for at in there if at not in new]
        options = {at: _options(space.scales[at], held, measures) for at in there}
        staying = {at: _staying(space.scales[at], held, measures) for at in free}
        for count in range(min(len(free), MOST_MOVES) + 1):
            for moving in combinations(free, count):
                kept = sum(staying[at] for at in free if at not in moving)
                for chosen in product(*(options[at] for at in (*new, *moving))):
                    places = dict(zip((*new, *moving), chosen, strict=True))
                    if self._agree(places, measures):
                        following = _Next(present | space.close(kept | _sum(chosen)), present, kept, places)
                        edges = ((following.graph ^ mask) & space.edges).bit_count()
                        way = sum(_way(space.scales[at], place, measures) for at, place in places.items())
                        yield (float(count), way, float(edges)), following

    def _agree(self, places: dict[int, _Option], measures: dict[str, float]) -> bool:
        """Tell whether geometry lets measures lie so at once, those that stay where they are."""
        scales = self._space.scales
        for small, large in self._space.never_above.items():
            at = []
            for number in (small, large):
                value = measures.get(scales[number].name)
                stays = None if value is None else Interval(value, value, True, True)
                at.append(places[number].interval if number in places else stays)
            if at[0] is not None and at[1] is not None and not at[0].reaches(at[1]):
                return False
        return True

    def _change(self, fired: int, mask: int, following: _Next, measures: dict[str, float]) -> Change:
        states = self._procedure.states
        state = next(one for one in states if one.name == self._name(fired))
        moves = []
        needed = self._needed(fired, following, measures)
        for at in needed:
            name, interval = self._space.scales[at].name, following.places[at].interval
            now = measures.get(name)
            by = None if now is None else interval.way_from(now)
            moves.append(Move(name, self._said(at, interval), now, by))
        free = following.places.keys() - set(needed)
        open_edges = sum(self._space.scales[at].bits for at in free)  # hold or not, as it happens
        return Change(
            state=state.name,
            feel=state.feel,
            priority=fired,
            moves=tuple(moves),
            appear=tuple(self.bits(following.graph & ~mask & ~open_edges)),
            vanish=tuple(self.bits(mask & ~following.graph)),
            fits_already=fired < len(states) and self._rules[fired].fits(mask),
        )

    def _said(self, at: int, interval: Interval) -> str:
        """Say where a measure is to lie, without the limits that it never passes anyway."""
        scale = self._space.scales[at]
        low, high = interval.low, interval.high
        low, high = (-inf if low == scale.always.least else low), (inf if high == scale.always.most else high)
        return Interval(low, high, interval.low_in, interval.high_in).said(scale.name)

    def _needed(self, fired: int, following: _Next, measures: dict[str, float]) -> list[int]:
        """Return which measures must lie where they do; of those that are new, some may not matter."""
        space, free = self._space, list[int]()
        for at in following.places:
            trial = [*free, at]
            fixed = _sum(place for other, place in following.places.items() if other not in trial)
            choices = product(*(_options(space.scales[other], 0, {}) for other in trial))
            graphs = (space.close(following.kept | fixed | _sum(chosen)) for chosen in choices)
            if space.scales[at].name not in measures and all(
                self.fired(following.present | graph) == fired for graph in graphs
            ):
                free = trial
        return sorted(at for at in following.places if at not in free)

    def _name(self, fired: int) -> str:
        states = self._procedure.states
        return UNKNOWN if fired == len(states) else states[fired].name


def _options(scale: Scale, held: int, measures: dict[str, float]) -> list[_Option]:
    """Return where a measure may move, stretches on which the same would hold put together."""
    options: list[_Option] = []
    now = measures.get(scale.name)
    for cell in scale.cells:
        option = _Option(cell.interval, cell.after(held))
        if options and options[-1].mask == option.mask:
            option = _Option(options.pop().interval.joined(option.interval), option.mask)
        options.append(option)
    return [one for one in options if now is None or now not in one.interval]


def _staying(scale: Scale, held: int, measures: dict[str, float]) -> int:
    """Return what goes on to hold, `given` left aside, where a measure stays."""
    return scale.cell_at(measures[scale.name]).after(held)


def _sum(chosen: Iterable[_Option]) -> int:
    """Return all relations that would hold."""
    return sum(one.mask for one in chosen)


def _way(scale: Scale, place: _Option, measures: dict[str, float]) -> float:
    """Return how far a measure moves [mm]; degrees as far as they move a tip."""
    now = measures.get(scale.name)
    way = 0.0 if now is None else abs(place.interval.way_from(now))
    return way * MM_PER_DEG if scale.measure.endswith("_deg") else way
