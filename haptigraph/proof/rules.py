"""The rules of a procedure, and questions about them, as bits: what must be there and what must not.

Written a second time, beside the rule engine, so that one can be held against the other.
"""

from collections.abc import Iterable
from typing import Protocol

from msgspec import Struct

from haptigraph.graph import Names
from haptigraph.inference.procedure import Procedure
from haptigraph.proof.space import Space, World

__all__ = ["Cube", "Prover", "cube", "cubes_of"]


class Cube(Struct, frozen=True):
    """All graphs that have some bits and do not have others."""

    require: int = 0
    forbid: int = 0

    def __and__(self, other: "Cube") -> "Cube":
        return Cube(self.require | other.require, self.forbid | other.forbid)

    def fits(self, mask: int) -> bool:
        """Tell whether a graph is among them."""
        return mask & self.require == self.require and not mask & self.forbid


class Prover(Protocol):
    """Answers questions about all possible graphs of one procedure."""

    method: str
    """In words, for people."""

    def exists(self, wanted: Cube, fires: int | None = None) -> bool:
        """Tell whether there is a possible graph.

        Args:
            wanted: What must be there, and what not.
            fires: The rule that is to be the first that fits; the number of rules: none; None: any.
        """

    def smallest(self, wanted: Cube, fires: int | None = None) -> World | None:
        """Return such a graph with the fewest edges and nodes, or None if there is none."""


def cube(
    space: Space,
    *,
    when: Iterable[Names] = (),
    unless: Iterable[Names] = (),
    present: Iterable[str] = (),
    absent: Iterable[str] = (),
) -> Cube:
    """Return the graphs with some edges and entities, and without others."""
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


def cubes_of(procedure: Procedure, space: Space) -> list[Cube]:
    """Return the graphs that each rule fits, in their order."""
    return [
        cube(space, when=state.when, unless=state.unless, absent=state.absent) for state in procedure.states
    ]
