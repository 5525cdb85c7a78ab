"""The rules of a procedure, and queries about them, as bit masks of required and forbidden bits.

Deliberately independent of the rule engine, so that tests can check one against the other.
"""

from collections.abc import Iterable
from typing import Protocol

from msgspec import Struct

from haptigraph.graph import Names
from haptigraph.inference.procedure import Procedure
from haptigraph.proof.space import Space, World

__all__ = ["Cube", "Prover", "make_cube", "rule_cubes"]


class Cube(Struct, frozen=True):
    """All graphs in which some bits are set and others are not."""

    require: int = 0
    forbid: int = 0

    def matches(self, mask: int) -> bool:
        """Return whether a graph is in the cube."""
        return mask & self.require == self.require and not mask & self.forbid


class Prover(Protocol):
    """Decide queries about all possible graphs of one procedure."""

    method: str
    """Description for people."""

    def is_satisfiable(self, cube: Cube, first_match: int | None = None) -> bool:
        """Return whether a possible graph satisfies a query.

        Args:
            cube: The graph must be in this cube.
            first_match: This rule must be the first that matches; the number of rules: none may match;
                None: any.
        """

    def smallest_witness(self, cube: Cube, first_match: int | None = None) -> World | None:
        """Return such a graph with the fewest edges and nodes, or None if there is none."""


def make_cube(
    space: Space,
    *,
    when: Iterable[Names] = (),
    unless: Iterable[Names] = (),
    present: Iterable[str] = (),
    absent: Iterable[str] = (),
) -> Cube:
    """Return the cube of the graphs with some edges and entities, and without others."""
    require = forbid = 0
    for names in when:
        require |= space.edge_bits[names]
    for names in unless:
        forbid |= space.edge_bits[names]
    for name in present:
        require |= space.entity_bits[name]
    for name in absent:
        forbid |= space.entity_bits[name]
    return Cube(require, forbid)


def rule_cubes(procedure: Procedure, space: Space) -> list[Cube]:
    """Return the cube of each rule, in order of priority."""
    return [
        make_cube(space, when=state.when, unless=state.unless, absent=state.absent)
        for state in procedure.states
    ]
