"""Find the shortest motions of the needle that lead from one moment to every other state.

The needle pivots about its trocar. It turns first, at its current depth, then moves along the shaft. A
motion's length is the way of the tip: the arc of the turn at the current depth, and the way along the shaft.
A grid of motions proposes; the scene builder and the rule engine confirm, pose by pose along the whole way.
"""

import math
from collections.abc import Callable

import numpy as np
from msgspec import Struct
from msgspec.structs import replace
from numpy.typing import NDArray

from haptigraph.geometry import Point, Polyline, Vec, norm, subtract
from haptigraph.graph import SceneGraph
from haptigraph.inference.engine import RuleEngine, without_time
from haptigraph.inference.procedure import Procedure
from haptigraph.messages import UNKNOWN, Observation
from haptigraph.proof.motion.needle import Needle
from haptigraph.proof.motion.sweep import Flags, Passed, Sweep, Swept
from haptigraph.scene.builder import SchemaSceneBuilder

__all__ = ["RESOLUTION_MM", "Motion", "MotionSearch", "motion_steps"]

RESOLUTION_MM = 0.05
"""States on the way are checked at least so densely."""
UNIT = 100  # motions are promised in hundredths of a mm and of a degree
FINE, MIDDLE, COARSE = 5, 10, 25  # spacing of the grid in these units, near and far
NEAR, FAR = 100, 300  # end of the fine and the middle spacing
PLAIN = 0.95  # a motion that only turns, or only moves along the shaft, may be longer by this
TARGET = "retina_target"


class Motion(Struct, frozen=True):
    """A motion of the needle that leads to a state."""

    state: str
    turn_deg: float
    """First a turn about the trocar, counter-clockwise in the eye frame."""
    advance_mm: float
    """Then a motion along the shaft, into the eye."""
    length_mm: float
    """Way of the tip: the arc of the turn at the current depth, and the way along the shaft."""
    passes: tuple[str, ...] = ()
    """States on the way, in order."""
    alarms: tuple[str, ...] = ()
    """Those of them that are alarms."""
    pierces: bool = False
    """Whether the tip leaves the globe other than through the trocar."""
    appear: tuple[str, ...] = ()
    """Edges that it adds to the graph."""
    vanish: tuple[str, ...] = ()
    """Edges that it removes from the graph."""
    target_mm: Vec | None = None
    """Where the target would have to be (eye frame), for a state that no motion leads to."""

    @property
    def warns(self) -> bool:
        """Whether it passes an alarm or pierces the globe."""
        return self.pierces or bool(self.alarms)


class _Found(Struct, frozen=True):
    """A motion of the grid, in hundredths of a degree and of a mm."""

    cost_mm: float
    """Its length [mm], less where it is plain."""
    turn: int
    advance: int
    turn_inner: int
    """The next smaller turn of the grid."""
    advance_inner: int
    """The next smaller motion along the shaft."""


class _Side(Struct, frozen=True, eq=False):
    """The states of all motions to one side and in one direction, (advances, turns)."""

    turn: NDArray[np.int64]
    advance: NDArray[np.int64]
    rules: NDArray[np.int64]
    warned: Flags
    """Whether another alarm was passed before, or the globe is pierced."""


class MotionSearch:
    """Search the motions of the needle from one moment.

    Args:
        procedure: A checked procedure.
        needle: The needle as observed.
        graph: The graph of the observation.

    Raises:
        ValueError: If a measure's change with the needle's motion is not known.
    """

    def __init__(self, procedure: Procedure, needle: Needle, graph: SceneGraph) -> None:
        self._procedure, self._needle, self._graph = without_time(procedure), needle, graph
        self._sweep = Sweep(procedure, needle, graph)
        names = [state.name for state in procedure.states]
        self._names = [*names, UNKNOWN]
        kinds = procedure.kinds
        self._is_alarm = np.array([kinds[name] == "alarm" for name in self._names])
        zero = np.zeros((1, 1))
        self._now = self._sweep.along(zero, zero).first

    def motions(self) -> list[Motion]:
        """Return the shortest motion to every state that can be reached, shortest first.

        If the shortest one passes an alarm or pierces the globe and another does not, the latter comes first,
        then the former. A motion that only turns or only moves along the shaft is preferred if it is longer
        by 5 % at most.
        """
        found: list[list[Motion]] = []
        for rule, ways in self._on_grid().items():
            confirmed = [self._confirmed(self._refined(rule, way, clean), rule) for clean, way in ways]
            motions = sorted((one for one in confirmed if one), key=lambda one: (one.warns, one.length_mm))
            if len(motions) == 2 and motions[1].length_mm >= motions[0].length_mm:
                motions.pop()
            if motions:
                found.append(motions)
        found.sort(key=lambda motions: motions[0].length_mm)
        return [motion for motions in found for motion in motions]

    def _on_grid(self) -> dict[int, list[tuple[bool, _Found]]]:
        """Return the shortest motions of the grid to every rule's state, with and without a warning."""
        best: dict[tuple[int, bool], _Found] = {}
        for side in self._sides():
            turn_mm = np.abs(side.turn) * self._needle.mm_per_deg
            cost_mm = (np.abs(side.advance)[:, None] + turn_mm) / UNIT
            cost_mm[0] *= PLAIN
            cost_mm[:, 0] *= PLAIN
            for rule in np.unique(side.rules):
                for clean in (False, True):
                    fits = (side.rules == rule) & ~(side.warned & clean)
                    if not fits.any() or self._names[rule] == self._names[self._now]:
                        continue
                    row, column = divmod(int(np.where(fits, cost_mm, np.inf).argmin()), cost_mm.shape[1])
                    found = _Found(
                        float(cost_mm[row, column]),
                        int(side.turn[column]),
                        int(side.advance[row]),
                        int(side.turn[max(column - 1, 0)]),
                        int(side.advance[max(row - 1, 0)]),
                    )
                    key = int(rule), clean
                    if key not in best or found.cost_mm < best[key].cost_mm:
                        best[key] = found
        rules = {rule for rule, _ in best}
        return {
            rule: [(clean, best[rule, clean]) for clean in (False, True) if self._matters(best, rule, clean)]
            for rule in rules
        }

    @staticmethod
    def _matters(best: dict[tuple[int, bool], _Found], rule: int, clean: bool) -> bool:
        """Return whether a way is to be refined: the clean one, and a shorter one that is not."""
        free = best.get((rule, True))
        return free is not None if clean else free is None or best[rule, False].cost_mm < free.cost_mm

    def _sides(self) -> list[_Side]:
        """Return the states of all motions of the grid."""
        sides = []
        for turn in _axes(self._needle.turn_range_deg):
            turn_deg = turn[:, None] / UNIT
            turned = self._sweep.along(turn_deg, np.zeros((1, 1)))
            passed = self._passed(turned).ends()
            before = np.concatenate([[False], passed.alarmed[:-1]])
            held = {names: edges[:, 0] for names, edges in turned.edges.items()}
            for advance in _axes(self._needle.advance_range_mm):
                swept = self._sweep.along(turn_deg.T, advance[:, None] / UNIT, held)
                after = self._passed(swept, passed)
                warned = np.vstack([before, after.alarmed[:-1]]) | after.pierced
                sides.append(_Side(turn, advance, swept.rules, warned))
        return sides

    def _passed(self, swept: Swept, before: Passed | None = None) -> Passed:
        return Passed.along(swept, self._now, self._is_alarm, before)

    def _refined(self, rule: int, way: _Found, clean: bool) -> tuple[int, int]:
        """Return the way, shortened below the spacing of the grid, in hundredths of a degree and of a mm."""

        def arrives(turn: int, advance: int) -> bool:
            path = motion_steps(turn / UNIT, advance / UNIT, self._needle.mm_per_deg)
            swept = self._sweep.along(path[:, :1], path[:, 1:])
            passed = self._passed(swept)
            warned = passed.alarmed[:-1].any() or passed.pierced.any()
            return bool(swept.rules[-1, 0] == rule and not (clean and warned))

        turn, advance = way.turn, way.advance
        advance = _bisected(way.advance_inner, advance, lambda one: arrives(turn, one))
        turn = _bisected(way.turn_inner, turn, lambda one: arrives(one, advance))
        return turn, advance

    def _confirmed(self, way: tuple[int, int], rule: int) -> Motion | None:
        """Return a motion with the states on its way; None if it ends elsewhere."""
        turn_deg, advance_mm = way[0] / UNIT, way[1] / UNIT
        path = motion_steps(turn_deg, advance_mm, self._needle.mm_per_deg)
        graphs = self._graphs([self._needle.moved(*pose) for pose in path.tolist()])
        engine = RuleEngine(self._procedure)
        states: list[str] = []
        for graph in graphs:
            state = engine(graph).state
            if not states or state != states[-1]:
                states.append(state)
        if states[-1] != self._names[rule]:
            return None
        passes = tuple(states[1:-1])
        kinds, diff = self._procedure.kinds, self._graph.diff(graphs[-1])
        swept = self._sweep.along(path[:, :1], path[:, 1:])
        return Motion(
            state=states[-1],
            turn_deg=turn_deg,
            advance_mm=advance_mm,
            length_mm=abs(advance_mm) + abs(turn_deg) * self._needle.mm_per_deg,
            passes=passes,
            alarms=tuple(dict.fromkeys(one for one in passes if kinds[one] == "alarm")),
            pierces=bool(self._passed(swept).pierced.any()),
            appear=tuple(map(str, diff.edges_appeared)),
            vanish=tuple(map(str, diff.edges_vanished)),
        )

    def _graphs(self, observations: list[Observation]) -> list[SceneGraph]:
        """Return the graphs of observations that follow this moment."""
        builder = SchemaSceneBuilder(self._procedure.schema)
        builder.resume(self._graph)
        return [builder(observation) for observation in observations]

    def with_target(self, states: set[str]) -> list[Motion]:
        """Return where the target would have to be for states that no motion leads to, nearest first.

        Args:
            states: The names of the states.
        """
        found = self._needle.observation.found
        target, retina = found.get(TARGET), found.get("retina_surface")
        if not (isinstance(target, Point) and isinstance(retina, Polyline)):
            return []
        points_mm = sorted(retina.points_mm, key=lambda at_mm: norm(subtract(at_mm, target.at_mm)))
        motions: dict[str, Motion] = {}
        for at_mm in points_mm:
            moved = replace(self._needle.observation, found=found | {TARGET: Point(at_mm)})
            graph = self._graphs([moved])[0]
            state = RuleEngine(self._procedure)(graph).state
            if state in states and state not in motions:
                diff = self._graph.diff(graph)
                edges = (tuple(map(str, some)) for some in (diff.edges_appeared, diff.edges_vanished))
                appear, vanish = edges
                motions[state] = Motion(state, 0.0, 0.0, 0.0, appear=appear, vanish=vanish, target_mm=at_mm)
        return list(motions.values())


def motion_steps(turn_deg: float, advance_mm: float, mm_per_deg: float) -> NDArray[np.float64]:
    """Return the poses of a motion, from the current one to its end.

    Args:
        turn_deg: First a turn, at the current depth.
        advance_mm: Then a motion along the shaft.
        mm_per_deg: Arc of the tip for 1 degree of the turn.

    Returns:
        Turns [deg] and motions along the shaft [mm], (poses, 2), at most `RESOLUTION_MM` apart, and 0.05
        degrees.
    """
    turns = math.ceil(abs(turn_deg) * max(mm_per_deg, 1.0) / RESOLUTION_MM)
    advances = math.ceil(abs(advance_mm) / RESOLUTION_MM)
    path = np.zeros((1 + turns + advances, 2))
    path[: turns + 1, 0] = np.linspace(0.0, turn_deg, turns + 1)
    path[turns + 1 :, 0] = turn_deg
    path[turns:, 1] = np.linspace(0.0, advance_mm, advances + 1)
    return path


def _axes(reach: tuple[float, float]) -> list[NDArray[np.int64]]:
    """Return the grid to either side, from 0 outwards, in hundredths."""
    axes = []
    for end in reach:
        last = int(abs(end) * UNIT)
        near = [np.arange(0, NEAR, FINE), np.arange(NEAR, FAR, MIDDLE), np.arange(FAR, last + 1, COARSE)]
        steps = np.concatenate(near)
        axes.append(int(math.copysign(1, end)) * steps[steps <= last])
    return axes


def _bisected(inner: int, outer: int, arrives: Callable[[int], bool]) -> int:
    """Return the value nearest to the inner one at which a motion arrives, and would a step further."""
    if inner == outer or arrives(inner):
        return inner
    end = outer
    while abs(outer - inner) > 1:
        middle = (outer + inner) // 2
        if arrives(middle):
            outer = middle
        else:
            inner = middle
    further = outer + (outer - inner)  # exactly at a threshold, rounding would decide
    return further if outer != end and arrives(further) else outer
