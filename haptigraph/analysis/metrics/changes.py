"""Changes that lead from one moment to other states: motions of the needle, else the smallest of measures."""

from msgspec.structs import replace

from haptigraph.graph import SceneGraph
from haptigraph.inference.procedure import Procedure
from haptigraph.messages import Observation
from haptigraph.proof.motion.needle import needle_of
from haptigraph.proof.motion.search import Motion, MotionSearch
from haptigraph.proof.nearest import Change, Nearest

__all__ = ["change_text", "motion_text", "possible_changes"]


def possible_changes(
    procedure: Procedure, graph: SceneGraph, observation: Observation | None
) -> tuple[list[Change], str]:
    """Return the changes that lead to every other state, and why motion was not considered.

    Args:
        procedure: A checked procedure.
        graph: The graph of this moment.
        observation: What it was built from; None if unknown.

    Returns:
        Changes: those by a motion of the needle first, shortest first; then those by another target; then the
        others, by measures, smallest first. The reason is empty if motion was considered.
    """
    nearest = Nearest(procedure, graph.sds)
    changes = nearest.changes(nearest.mask(graph), graph.measures)
    needle = None if observation is None else needle_of(observation)
    if needle is None:
        return changes, "it needs the tip and the shaft of a needle, its trocar and the globe"
    try:
        search = MotionSearch(procedure, needle, graph)
    except ValueError as error:
        return changes, str(error)
    motions = search.motions()
    unreached = {change.state for change in changes} - {motion.state for motion in motions}
    motions += search.with_target(unreached)
    by_state: dict[str, list[Motion]] = {}
    for motion in motions:
        by_state.setdefault(motion.state, []).append(motion)
    moved = [_by_motion(procedure, changes, state, tuple(ways)) for state, ways in by_state.items()]
    return [*moved, *(change for change in changes if change.state not in by_state)], ""


def _by_motion(
    procedure: Procedure, changes: list[Change], state: str, motions: tuple[Motion, ...]
) -> Change:
    """Return a change by motions; what it adds to the graph and removes is that of the first."""
    first = motions[0]
    logical = next((change for change in changes if change.state == state), None)
    if logical is not None:
        return replace(logical, moves=(), appear=first.appear, vanish=first.vanish, motions=motions)
    names = [one.name for one in procedure.states]
    rule = names.index(state)
    feel = procedure.states[rule].feel
    return Change(state, feel, rule, (), first.appear, first.vanish, fits_already=False, motions=motions)


def change_text(change: Change) -> list[str]:
    """Return a change as lines of text."""
    head = f"{change.state} (rule {change.priority}, feels {change.feel!r})"
    lines = [f"{head}, which fits, too, but has lower priority" if change.fits_already else head]
    for number, motion in enumerate(change.motions):
        first, *rest = motion_text(motion)
        lines += [f"  {'shorter: ' if number else ''}{first}", *(f"  {line}" for line in rest)]
    for move in change.moves:
        if move.value is None or move.way is None:
            lines.append(f"  if {move.to}")
        else:
            unit = move.measure.rpartition("_")[2]
            way = f"{abs(move.way):.3g} {unit} {'less' if move.way < 0 else 'more'}"
            lines.append(f"  if {move.to}: it is {move.value:.4g}, {way if move.way else 'at the threshold'}")
    changed = [f"+ {name}" for name in change.appear] + [f"- {name}" for name in change.vanish]
    return [*lines, f"  graph: {'  '.join(changed)}"]


def motion_text(motion: Motion) -> list[str]:
    """Return a motion as lines of text."""
    if motion.target_mm is not None:
        x, y = motion.target_mm
        return [f"by no motion of the needle, but with the target at ({x:.2f}, {y:.2f}) mm"]
    parts = []
    if motion.turn_deg:
        side = "counter-clockwise" if motion.turn_deg > 0 else "clockwise"
        parts.append(f"turn {abs(motion.turn_deg):.2f}° {side}")
    if motion.advance_mm:
        verb = "advance" if motion.advance_mm > 0 else "withdraw"
        parts.append(f"{verb} {abs(motion.advance_mm):.2f} mm along the shaft")
    lines = [f"{', then '.join(parts) or 'stay'}: the tip moves {motion.length_mm:.2f} mm"]
    if motion.passes:
        lines.append(f"on the way: {', '.join(motion.passes)}")
    if motion.alarms:
        lines.append(f"passes an alarm: {', '.join(motion.alarms)}")
    if motion.pierces:
        lines.append("pierces the wall of the globe")
    return lines
