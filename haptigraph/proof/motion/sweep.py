"""Apply a procedure to many poses of the needle at once, along paths, with hysteresis."""

from functools import reduce

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from haptigraph.graph import Names, Relation, SceneGraph, Triplet
from haptigraph.inference.procedure import Procedure
from haptigraph.proof.motion.measuring import measuring_of
from haptigraph.proof.motion.needle import Needle

__all__ = ["Flags", "Passed", "Sweep", "Swept"]

Flags = NDArray[np.bool_]


class Swept(Struct, frozen=True, eq=False):
    """What holds along paths."""

    rules: NDArray[np.int64]
    """Index of the rule that fires, (poses of a path, paths); the number of rules if none does."""
    edges: dict[Names, Flags]
    """Whether each relation holds, (poses of a path, paths)."""
    beyond: Flags
    """Whether the tip is outside the globe on the far side of its centre, (poses of a path, paths)."""

    @property
    def first(self) -> int:
        """The rule that fires at the first pose of the first path."""
        return int(self.rules[0, 0])


class Passed(Struct, frozen=True, eq=False):
    """What was passed on the way to the poses of paths, (poses, paths) or, for the last poses, (paths,)."""

    left: Flags
    """Whether the present state was left."""
    alarmed: Flags
    """Whether an alarm was met since."""
    was_within: Flags
    """Whether the tip was within the globe's far side."""
    pierced: Flags
    """Whether it went beyond since."""

    @classmethod
    def along(cls, swept: Swept, now: int, is_alarm: Flags, before: "Passed | None" = None) -> "Passed":
        """Return what is passed along paths, after what was passed before."""
        none = np.zeros(swept.rules.shape[1:], bool)
        before = before or cls(none, none, none, none)
        left = np.logical_or.accumulate(swept.rules != now) | before.left
        alarmed = np.logical_or.accumulate(left & is_alarm[swept.rules]) | before.alarmed
        was_within = np.logical_or.accumulate(~swept.beyond) | before.was_within
        pierced = np.logical_or.accumulate(was_within & swept.beyond) | before.pierced
        return cls(left, alarmed, was_within, pierced)

    def ends(self) -> "Passed":
        """Return what one path of many poses passed to each of them, as paths."""
        return Passed(self.left[:, 0], self.alarmed[:, 0], self.was_within[:, 0], self.pierced[:, 0])


class Sweep:
    """Evaluate a procedure along motions of a needle.

    Args:
        procedure: A checked procedure.
        needle: The needle as observed.
        graph: The graph of the observation, with the standard deviations in use.

    Raises:
        ValueError: If a measure's change with the needle's motion is not known.
    """

    def __init__(self, procedure: Procedure, needle: Needle, graph: SceneGraph) -> None:
        self._procedure, self._needle = procedure, needle
        self._present = {node.category for node in graph.nodes}
        declared = {entity.name for entity in procedure.schema.entities}
        found = {
            name: shape
            for name, shape in needle.observation.found.items()
            if name in self._present or name not in declared
        }
        schema = procedure.schema.widened(graph.sds)
        self._relations = schema.relations
        self._names = [schema.measure_name(relation) for relation in schema.relations]
        self._measuring = {
            name: measuring_of(relation, needle, found)
            for name, relation in zip(self._names, self._relations, strict=True)
        }
        self.held = {names: np.array([Triplet(*names) in graph.edges]) for names in self._all_names()}
        """Whether each relation holds now, (1,)."""

    def _all_names(self) -> list[Names]:
        return [relation.names for relation in self._relations]

    def along(
        self,
        turn_deg: NDArray[np.float64],
        advance_mm: NDArray[np.float64],
        held: dict[Names, Flags] | None = None,
    ) -> Swept:
        """Return what holds along paths.

        Args:
            turn_deg: Turns, (poses of a path, paths), or of a shape that broadcasts to it.
            advance_mm: Motions along the shaft, likewise.
            held: Relations that hold before the first pose, (paths,) each; None: those that hold now.
        """
        turn_deg, advance_mm = np.broadcast_arrays(turn_deg, advance_mm)
        shape = turn_deg.shape
        tips, along = self._needle.swept(turn_deg.ravel(), advance_mm.ravel())
        values = {
            name: None if measure is None else measure(tips, along).reshape(shape)
            for name, measure in self._measuring.items()
        }
        held = held or self.held
        edges: dict[Names, Flags] = {}
        for relation, name in zip(self._relations, self._names, strict=True):
            value = values[name]
            edges[relation.names] = (
                np.zeros(shape, bool)
                if value is None
                else _holding(relation, value, held[relation.names], [edges[one] for one in relation.given])
            )
        center = np.array(self._needle.globe.center_mm)[:, None]
        is_far = ((tips - center) * along).sum(axis=0) > 0
        beyond = is_far & (np.hypot(*(tips - center)) > self._needle.globe.radius_mm)
        return Swept(self._first_match(edges, shape), edges, beyond.reshape(shape))

    def _first_match(self, edges: dict[Names, Flags], shape: tuple[int, ...]) -> NDArray[np.int64]:
        """Return the index of the first rule that matches; the number of rules if none does."""
        states = self._procedure.states
        rules = np.full(shape, len(states))
        for number, state in reversed(list(enumerate(states))):
            if self._present & set(state.absent):
                continue
            conditions = [edges[names] for names in state.when] + [~edges[names] for names in state.unless]
            rules[reduce(np.logical_and, conditions, np.ones(shape, bool))] = number
        return rules


def _holding(relation: Relation, value: NDArray[np.float64], held: Flags, given: list[Flags]) -> Flags:
    """Return where a relation without margin holds along paths, (poses of a path, paths)."""
    given_all = reduce(np.logical_and, given, np.ones(value.shape, bool))
    small = _below(value, relation.at_most, relation.below)
    large = _below(-value, _negative(relation.at_least), _negative(relation.above))
    begins = small & large & given_all
    if relation.release is None:
        return begins
    if relation.releases_upwards:
        small = value <= relation.release
    else:
        large = value >= relation.release
    stays = small & large & given_all
    holds = np.empty_like(begins)
    last = np.broadcast_to(held, begins.shape[1:])
    for pose in range(len(begins)):
        last = np.where(last, stays[pose], begins[pose])
        holds[pose] = last
    return holds


def _below(value: NDArray[np.float64], at_most: float | None, below: float | None) -> Flags:
    holds = np.ones(value.shape, bool)
    if at_most is not None:
        holds &= value <= at_most
    if below is not None:
        holds &= value < below
    return holds


def _negative(bound: float | None) -> float | None:
    return None if bound is None else -bound
