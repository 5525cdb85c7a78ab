"""A procedure as tables for people: relations with their thresholds, states by priority, touch."""

from rich.table import Table

from haptigraph.graph import Relation
from haptigraph.haptics.pattern import duration_ns
from haptigraph.inference.procedure import Procedure, State
from haptigraph.messages import Follow, Pattern
from haptigraph.proof.subject import bounds_of

__all__ = ["explain", "felt"]


def explain(procedure: Procedure) -> list[Table]:
    """Return the tables of a checked procedure."""
    relations = Table(title="Relations", title_justify="left")
    for heading in ("relation", "holds when"):
        relations.add_column(heading, overflow="fold")
    for relation in procedure.schema.relations:
        relations.add_row(_triplet(relation.names), _condition(relation, procedure))
    states = Table(title="States, first that fits wins", title_justify="left")
    for heading in ("", "state", "when", "feels"):
        states.add_column(heading, overflow="fold")
    for priority, state in enumerate(procedure.states):
        states.add_row(str(priority), state.name, _when(state), state.feel)
    patterns = Table(title="Touch", title_justify="left")
    for heading in ("pattern", "felt as"):
        patterns.add_column(heading, overflow="fold")
    for pattern in procedure.patterns:
        patterns.add_row(pattern.name, felt(pattern))
    return [relations, states, patterns]


def _triplet(names: tuple[str, str, str]) -> str:
    return f"<{', '.join(names)}>"


def _condition(relation: Relation, procedure: Procedure) -> str:
    told = [bounds_of(relation).said(procedure.schema.measure_name(relation))]
    if relation.release is not None:
        told.append(f"released at {relation.release:g}")
    return " and ".join([*told, *(_triplet(given) for given in relation.given)])


def _when(state: State) -> str:
    told = [_triplet(names) for names in state.when]
    told += [f"not {_triplet(names)}" for names in state.unless]
    told += [f"no {name}" for name in state.absent]
    return "\n".join(told) or "always"


def felt(pattern: Pattern) -> str:
    """Say in words what a pattern feels like."""
    if pattern.kind == "off":
        return "silence"
    strength = f"amplitude {pattern.amplitude:g}"
    if pattern.frequency_hz:
        strength += f" at {pattern.frequency_hz:g} Hz"
    rhythm = f"{pattern.on_ms:g} ms on, {pattern.off_ms:g} ms off"
    how = {
        "continuous": "without pause",
        "pulses": f"{rhythm}, on and on",
        "bursts": f"{pattern.count} x {rhythm}, once ({(duration_ns(pattern) or 0) / 1e6:g} ms)",
    }[pattern.kind]
    follows = [_follows(follow) for follow in pattern.follow]
    rearms = [f"again after {pattern.rearm_ms:g} ms"] if pattern.rearm_ms else []
    return "; ".join([f"{strength}, {how}", *follows, *rearms])


def _follows(follow: Follow) -> str:
    (first, low), (last, high) = follow.start, follow.end
    return f"{follow.key} {low:g} to {high:g} as {follow.measure} goes from {first:g} to {last:g}"
