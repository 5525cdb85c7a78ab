"""A procedure as tables for people: relations with their thresholds, states by priority, haptic patterns."""

from rich.table import Table

from haptigraph.grammar import ForceField
from haptigraph.graph import Relation, Triplet
from haptigraph.haptics.pattern import duration_ns
from haptigraph.inference.procedure import Procedure, State
from haptigraph.messages import Follow, Pattern
from haptigraph.proof.subject import bounds_of

__all__ = ["explain", "force_text", "pattern_text"]


def explain(procedure: Procedure) -> list[Table]:
    """Return the tables of a checked procedure."""
    relations = Table(title="Relations", title_justify="left")
    for heading in ("relation", "holds when"):
        relations.add_column(heading, overflow="fold")
    for relation in procedure.schema.relations:
        relations.add_row(str(Triplet(*relation.names)), _condition(relation, procedure))
    states = Table(title="States, first that fits wins", title_justify="left")
    for heading in ("", "state", "kind", "when", "feels"):
        states.add_column(heading, overflow="fold")
    kinds = procedure.kinds
    for priority, state in enumerate(procedure.states):
        kind = kinds[state.name] + ("" if state.kind else " (assumed)")
        exerts = f", exerts {', '.join(state.force)}" if state.force else ""
        feels = state.feel + exerts + _lasting(state)
        states.add_row(str(priority), state.name, kind, _when(state), feels)
    patterns = Table(title="Haptic patterns", title_justify="left")
    for heading in ("pattern", "output"):
        patterns.add_column(heading, overflow="fold")
    for pattern in procedure.patterns:
        patterns.add_row(pattern.name, pattern_text(pattern))
    return [relations, states, patterns, *([_forces_table(procedure)] if procedure.forces else [])]


def _forces_table(procedure: Procedure) -> Table:
    forces = Table(title="Forces", title_justify="left")
    for heading in ("force", "pushes the hand"):
        forces.add_column(heading, overflow="fold")
    for field in procedure.forces:
        forces.add_row(field.name, force_text(field))
    return forces


def _condition(relation: Relation, procedure: Procedure) -> str:
    parts = [bounds_of(relation).describe(procedure.schema.measure_name(relation))]
    if relation.margin_sd:
        parts[0] += f" within {relation.margin_sd:g} standard deviations"
    if relation.release is not None:
        parts.append(f"released at {relation.release:g}")
    parts += [str(Triplet(*given)) for given in relation.given]
    return " and ".join(parts) + (f" (meant: {relation.reason})" if relation.reason else "")


def _lasting(state: State) -> str:
    """Describe when a state begins and ends later than its rule."""
    parts = [f"after {state.enter_after_ms:g} ms"] if state.enter_after_ms else []
    parts += [f"held for {state.hold_ms:g} ms"] if state.hold_ms else []
    return f" ({', '.join(parts)})" if parts else ""


def _when(state: State) -> str:
    conditions = [str(Triplet(*names)) for names in state.when]
    conditions += [f"not {Triplet(*names)}" for names in state.unless]
    conditions += [f"no {name}" for name in state.absent]
    return "\n".join(conditions) or "always"


def pattern_text(pattern: Pattern) -> str:
    """Describe a haptic pattern in words."""
    if pattern.kind == "off":
        return "silence"
    strength = f"amplitude {pattern.amplitude:g}"
    if pattern.frequency_hz:
        strength += f" at {pattern.frequency_hz:g} Hz"
    rhythm = f"{pattern.on_ms:g} ms on, {pattern.off_ms:g} ms off"
    how = {
        "continuous": "continuous",
        "pulses": f"{rhythm}, repeated",
        "bursts": f"{pattern.count} x {rhythm}, once ({(duration_ns(pattern) or 0) / 1e6:g} ms)",
    }[pattern.kind]
    follows = [_follows(follow) for follow in pattern.follow]
    rearms = [f"again after {pattern.rearm_ms:g} ms"] if pattern.rearm_ms else []
    return "; ".join([f"{strength}, {how}", *follows, *rearms])


def force_text(field: ForceField) -> str:
    """Describe a force field in words."""
    where = {
        "cone": f"towards the line trocar -> target, beyond {field.half_angle_deg:g} deg from it",
        "plane": f"away from the retina, below a height of {field.height_mm:g} mm",
        "viscous": "against its motion",
    }[field.kind]
    stiffness = [f"{field.stiffness_n_per_mm:g} N/mm"] if field.stiffness_n_per_mm else []
    damping = [f"{field.damping_n_s_per_mm:g} N s/mm"] if field.damping_n_s_per_mm else []
    return f"{where}; {' and '.join(stiffness + damping)}, at most {field.limit_n:g} N"


def _follows(follow: Follow) -> str:
    (first, low), (last, high) = follow.start, follow.end
    return f"{follow.key} {low:g} to {high:g} as {follow.measure} goes from {first:g} to {last:g}"
