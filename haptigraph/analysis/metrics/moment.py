"""Explain one moment of a run: the rule that fired, its triplets, and the nearest alternatives.

Applies the procedure stored in the recording.
"""

from array import array
from collections.abc import Sequence
from pathlib import Path

from msgspec import Struct
from msgspec.structs import replace

from haptigraph.analysis.metrics.changes import change_text, possible_changes
from haptigraph.analysis.metrics.replay import recorded_registration
from haptigraph.analysis.metrics.timeline import FaultSpan, FaultSpans
from haptigraph.analysis.plots.explanation import force_text, pattern_text
from haptigraph.assemble import parse_procedure
from haptigraph.errors import BadInput
from haptigraph.graph import SceneGraph, Triplet
from haptigraph.inference.engine import RuleEngine, without_time
from haptigraph.inference.procedure import Procedure, State
from haptigraph.messages import Observation
from haptigraph.proof.nearest import Change
from haptigraph.proof.subject import bounds_of
from haptigraph.recording.reader import RunReader
from haptigraph.registration.assumed import assumed_text

__all__ = ["Explanation", "Held", "Reason", "explain_graph", "explain_moment", "explanation_text"]

ROUNDED_S = 0.005
"""A time this shortly before a step means the step: logs and tables print two digits."""


class Reason(Struct, frozen=True):
    """One condition of a rule, and whether it held."""

    says: str
    """As text: "<a, b, c>", "not <a, b, c>", "no a"."""
    holds: bool
    because: str
    """The measure and its bounds: "theta_deg 5.12, bounds theta_deg > 1.7"; empty if there is none."""


class Held(Struct, frozen=True):
    """A state that was held although its graph had ended."""

    state: str
    feel: str
    because: str


class Explanation(Struct, frozen=True):
    """Why a state was concluded, and which changes would lead to another. Printed as JSON, too."""

    time_s: float
    """Since the first step of the run; 0 for a graph without a run."""
    state: str
    feel: str
    priority: int
    because: str
    fired_by: tuple[Reason, ...]
    not_fired: dict[str, tuple[Reason, ...]]
    """Unmet conditions of the rules with higher priority, by state."""
    measures: dict[str, float]
    runner_up: Change | None
    """The smallest change that leads to another state: the shortest motion, where motion is considered."""
    others: tuple[Change, ...]
    """Changes to the remaining states, smallest first."""
    faults: tuple[str, ...] = ()
    """What had failed at this moment, and since when."""
    held: Held | None = None
    """What was concluded instead, where a state outlasted its graph (`hold_ms`)."""
    assumed: tuple[str, ...] = ()
    """What the registration assumes, by name."""
    touch: str = ""
    """The commanded pattern and force fields; values that follow a measure are those of this moment."""
    motion: str = ""
    """Whether motions of the needle were considered: empty, or why not."""


def explain_moment(path: str | Path, at_s: float) -> Explanation:
    """Explain the step of a recording that was current at a moment.

    Args:
        path: The recording.
        at_s: Time since its first step.

    Raises:
        BadInput: If the recording cannot be read or does not include the moment.
    """
    reader = RunReader(path)
    procedure = parse_procedure(reader.info.procedure, f"procedure in {path}")
    first_ns = last_ns = None
    found, times_s, spans = None, array("d"), FaultSpans()
    for _, step in reader.places():
        first_ns = step.stamp_ns if first_ns is None else first_ns
        last_ns = step.stamp_ns
        step_s = (step.stamp_ns - first_ns) / 1e9
        if found is not None and 0 <= at_s < step_s - ROUNDED_S:
            break
        found = step
        spans.add(len(times_s), step)
        times_s.append(step_s)
    if found is None or first_ns is None or last_ns is None:
        raise BadInput("has no complete step to explain", path)
    time_s = times_s[-1]
    if at_s < 0 or at_s > (last_ns - first_ns) / 1e9 + 1:
        raise BadInput(f"has no step at {at_s:g} s; valid: 0 to {time_s:.2f} s", path)
    faults = tuple(_fault_text(span, times_s) for span in spans.open)
    explanation = explain_graph(procedure, found.graph, time_s, faults, found.observation)
    recorded, pattern = found.conclusion, found.command.pattern
    is_held = recorded.state != explanation.state
    held = Held(recorded.state, recorded.feel, recorded.because) if is_held else None
    assumed = recorded_registration(reader).assumed
    exerted = (f"force {force.name!r}: {force_text(force)}" for force in found.command.forces)
    touch = "; ".join((f"{pattern.name!r}: {pattern_text(pattern)}", *exerted))
    return replace(explanation, held=held, assumed=assumed, touch=touch)


def explain_graph(
    procedure: Procedure,
    graph: SceneGraph,
    time_s: float = 0.0,
    faults: tuple[str, ...] = (),
    observation: Observation | None = None,
) -> Explanation:
    """Explain what a procedure concludes from a graph.

    Args:
        procedure: A checked procedure.
        graph: The graph.
        time_s: Time of the graph since the first step of its run.
        faults: Faults of its step, as text.
        observation: What the graph was built from; without it, motions of the needle are not considered.
    """
    conclusion = RuleEngine(without_time(procedure))(graph)
    changes, motion = possible_changes(procedure, graph, observation)
    states = procedure.states
    fired = states[conclusion.priority : conclusion.priority + 1]
    return Explanation(
        time_s=time_s,
        state=conclusion.state,
        feel=conclusion.feel,
        priority=conclusion.priority,
        because=conclusion.because,
        fired_by=tuple(reason for state in fired for reason in _reasons(procedure, state, graph)),
        not_fired={
            state.name: tuple(reason for reason in _reasons(procedure, state, graph) if not reason.holds)
            for state in states[: conclusion.priority]
        },
        measures=dict(graph.measures),
        runner_up=changes[0] if changes else None,
        others=tuple(changes[1:]),
        faults=faults,
        motion=motion,
    )


def explanation_text(explanation: Explanation, *, has_all: bool = True) -> str:
    """Return an explanation as several lines of text, with all other states or the nearest alone."""
    moment = explanation
    by_graph = f"{moment.state}, rule {moment.priority}, feels {moment.feel!r}: {moment.because}"
    lines = [
        f"{moment.time_s:.2f} s  {by_graph}"
        if moment.held is None
        else f"{moment.time_s:.2f} s  {moment.held.state}, feels {moment.held.feel!r}: {moment.held.because}",
        *_section("commanded", [moment.touch] if moment.touch else []),
        *_section("by graph", [by_graph] if moment.held is not None else []),
        *_section("assumed", [f"{assumed_text(moment.assumed)}; not measured"] if moment.assumed else []),
        *(f"  fault      {fault}" for fault in moment.faults),
        *_section("fired by", [_reason_text(reason) for reason in moment.fired_by] or ["no rule"]),
    ]
    not_fired = [
        f"{state}: " + "; ".join(_missing_text(reason) for reason in reasons)
        for state, reasons in moment.not_fired.items()
    ]
    lines += _section("not fired", not_fired)
    if moment.runner_up is not None:
        lines += _section("runner-up", change_text(moment.runner_up))
    for change in moment.others if has_all else ():
        lines += _section("or", change_text(change))
    if moment.others and not has_all:
        lines += _section("or", [f"{len(moment.others)} more states: --all shows what leads to them"])
    if moment.motion:
        lines += _section("motion", [f"not considered: {moment.motion}"])
    return "\n".join(lines)


def _fault_text(span: FaultSpan, times_s: Sequence[float]) -> str:
    """Describe a fault, and since when it lasts if it began before the last step."""
    since = f", since {times_s[span.first]:.2f} s" if span.first < span.last else ""
    return f"{span.where}: {span.message}{since}"


def _reasons(procedure: Procedure, state: State, graph: SceneGraph) -> list[Reason]:
    category = {node.id: node.category for node in graph.nodes}
    edges = {(category[edge.subject], edge.predicate, category[edge.object]) for edge in graph.edges}
    relations = {relation.names: relation for relation in procedure.schema.relations}

    def measured(names: tuple[str, str, str]) -> str:
        relation = relations[names]
        name = procedure.schema.measure_name(relation)
        value = f"{graph.measures[name]:.4g}" if name in graph.measures else "missing"
        margin = f", margin {relation.margin_sd:g} standard deviations" if relation.margin_sd else ""
        if margin and name in graph.measures:
            margin += f" of {graph.sds[name]:.2g}" if name in graph.sds else ", which are unknown"
        return f"{name} {value}, bounds {bounds_of(relation).describe(name)}{margin}"

    reasons = [Reason(str(Triplet(*names)), names in edges, measured(names)) for names in state.when]
    reasons += [
        Reason(f"not {Triplet(*names)}", names not in edges, measured(names)) for names in state.unless
    ]
    return reasons + [Reason(f"no {name}", name not in category.values(), "") for name in state.absent]


def _reason_text(reason: Reason) -> str:
    return f"{reason.says}  ({reason.because})" if reason.because else reason.says


def _missing_text(reason: Reason) -> str:
    """Describe an unmet condition: a missing triplet, or one that should not be there."""
    if reason.says.startswith("<"):
        return f"no {reason.says}"
    return f"there is {reason.says.split(' ', 1)[1]}"


def _section(heading: str, lines: list[str]) -> list[str]:
    return [f"  {heading if not number else '':11}{line}" for number, line in enumerate(lines)]
