"""Find adjacent states: pairs between which one measure crosses one threshold, without uncertainty."""

from haptigraph.inference.procedure import Procedure
from haptigraph.messages import UNKNOWN
from haptigraph.proof.exhaustive_prover import MAX_WORLDS
from haptigraph.proof.rules import rule_cubes
from haptigraph.proof.space import Space

__all__ = ["neighbours"]


def neighbours(procedure: Procedure) -> list[tuple[str, str]]:
    """Return pairs of adjacent states in order of priority, without the state of an undetected needle.

    Returns none for a procedure with too many graphs to enumerate.
    """
    schema = procedure.schema
    space = Space(schema.widened(dict.fromkeys(schema.measure_names, 0.0)))
    if space.count() > MAX_WORLDS:
        return []
    rules = rule_cubes(procedure, space)
    names = [state.name for state in procedure.states]
    number = [{cell: at for at, cell in enumerate(scale.cells)} for scale in space.scales]
    adjacent: dict[tuple[object, ...], list[tuple[int, str]]] = {}
    for world in space.worlds():
        matched = next((at for at, rule in enumerate(rules) if rule.matches(world.mask)), None)
        if matched is None or names[matched] == UNKNOWN:
            continue
        present = world.mask & ~space.edges
        for at, cell_state in enumerate(world.cell_states):
            if cell_state is not None:
                others = (*world.cell_states[:at], *world.cell_states[at + 1 :])
                key = (present, at, others)
                adjacent.setdefault(key, []).append((number[at][cell_state.cell], names[matched]))
    pairs = {
        (one, other)
        for line in adjacent.values()
        for at, one in line
        for to, other in line
        if abs(at - to) == 1 and names.index(one) < names.index(other)
    }
    return sorted(pairs, key=lambda pair: (names.index(pair[0]), names.index(pair[1])))
