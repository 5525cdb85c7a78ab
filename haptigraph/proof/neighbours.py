"""Which states lie side by side: one measure crosses one threshold, and one becomes the other."""

from haptigraph.inference.procedure import Procedure
from haptigraph.messages import UNKNOWN
from haptigraph.proof.exhaustive import MOST_WORLDS
from haptigraph.proof.rules import cubes_of
from haptigraph.proof.space import Space

__all__ = ["neighbours"]


def neighbours(procedure: Procedure) -> list[tuple[str, str]]:
    """Return pairs of states that are neighbours, in order of priority, without that of seeing no needle.

    None for a procedure whose graphs are too many to be looked at.
    """
    space = Space(procedure.schema)
    if space.count() > MOST_WORLDS:
        return []
    rules = cubes_of(procedure, space)
    names = [state.name for state in procedure.states]
    number = [{cell: at for at, cell in enumerate(scale.cells)} for scale in space.scales]
    beside: dict[tuple[object, ...], list[tuple[int, str]]] = {}
    for world in space.worlds():
        fired = next((at for at, rule in enumerate(rules) if rule.fits(world.mask)), None)
        if fired is None or names[fired] == UNKNOWN:
            continue
        present = world.mask & ~space.edges
        for at, place in enumerate(world.places):
            if place is not None:
                others = (*world.places[:at], *world.places[at + 1 :])
                key = (present, at, others)
                beside.setdefault(key, []).append((number[at][place.cell], names[fired]))
    pairs = {
        (one, other)
        for line in beside.values()
        for at, one in line
        for to, other in line
        if abs(at - to) == 1 and names.index(one) < names.index(other)
    }
    return sorted(pairs, key=lambda pair: (names.index(pair[0]), names.index(pair[1])))
