"""Find adjacent states: pairs between which one measure crosses one threshold, without uncertainty."""

from collections.abc import Collection

from haptigraph.inference.procedure import Procedure
from haptigraph.messages import UNKNOWN
from haptigraph.proof.exhaustive_prover import MAX_WORLDS
from haptigraph.proof.rules import rule_cubes
from haptigraph.proof.space import Space

__all__ = ["Line", "lines_of", "neighbours", "nominal_space"]

Line = list[tuple[int, str]]
"""The states along one measure, all others fixed: (index of the cell on its scale, state)."""


def nominal_space(procedure: Procedure) -> Space:
    """Return the possible graphs of a procedure if nothing is uncertain."""
    schema = procedure.schema
    return Space(schema.widened(dict.fromkeys(schema.measure_names, 0.0)))


def neighbours(procedure: Procedure) -> list[tuple[str, str]]:
    """Return pairs of adjacent states in order of priority, without the state of an undetected needle.

    Returns none for a procedure with too many graphs to enumerate.
    """
    names = [state.name for state in procedure.states]
    space = nominal_space(procedure)
    pairs = {
        (one, other)
        for lines in lines_of(procedure, space, range(len(space.scales))).values()
        for line in lines
        for at, one in line
        for to, other in line
        if abs(at - to) == 1 and names.index(one) < names.index(other)
    }
    return sorted(pairs, key=lambda pair: (names.index(pair[0]), names.index(pair[1])))


def lines_of(procedure: Procedure, space: Space, scales: Collection[int]) -> dict[int, list[Line]]:
    """Return the states along some measures, for all that the other measures may be meanwhile.

    Args:
        procedure: A checked procedure.
        space: Its possible graphs; with too many to enumerate, there are no lines.
        scales: Indices of the measures' scales.
    """
    if space.count() > MAX_WORLDS:
        return {}
    rules = rule_cubes(procedure, space)
    names = [state.name for state in procedure.states]
    number = [{cell: at for at, cell in enumerate(scale.cells)} for scale in space.scales]
    lines: dict[int, dict[tuple[object, ...], Line]] = {at: {} for at in scales}
    for world in space.worlds():
        matched = next((at for at, rule in enumerate(rules) if rule.matches(world.mask)), None)
        if matched is None or names[matched] == UNKNOWN:
            continue
        present = world.mask & ~space.edges
        for at in scales:
            if (cell_state := world.cell_states[at]) is not None:
                others = (*world.cell_states[:at], *world.cell_states[at + 1 :])
                line = lines[at].setdefault((present, others), [])
                line.append((number[at][cell_state.cell], names[matched]))
    return {at: list(found.values()) for at, found in lines.items()}
