"""What a procedure's claims do not cover, and what nobody reports of what it speaks of."""

from collections.abc import Callable, Collection, Iterator

from haptigraph.errors import BadInput
from haptigraph.graph import Names, Relation, Triplet
from haptigraph.inference.procedure import Procedure, State
from haptigraph.stages import PerceiverClass

__all__ = [
    "CAMERA_ANATOMY",
    "NEEDLE_3D",
    "ROBOT_TIP",
    "check_margins",
    "reported_with",
    "uncovered",
    "unreported",
    "unreported_notes",
]

CAMERA_ANATOMY = frozenset(("eye_globe", "retina_surface", "retina_target", "trocar"))
"""What every registration of a camera reports."""
NEEDLE_3D = "needle_3d"
"""What a run before a depth camera reports, whatever its perceiver."""
ROBOT_TIP = "robot_tip"
"""What a run reports that reads a calibrated robot, whatever its perceiver."""
SCAN_ANATOMY = frozenset(("retina_surface",))
"""What every perceiver of B-scans reports besides the entities by which it is selected."""


def reported_with(perceiver: PerceiverClass) -> frozenset[str]:
    """Return the entities that a perceiver or the registration that it needs may report."""
    return perceiver.entities | (CAMERA_ANATOMY if perceiver.images == "eye" else SCAN_ANATOMY)


def uncovered(procedure: Procedure) -> list[str]:
    """Return what no claim of a procedure covers, a phrase each."""
    return [*_unclaimed(procedure), *_declared(procedure)]


def _unclaimed(procedure: Procedure) -> Iterator[str]:
    """Yield what nobody claims."""
    kinds = procedure.kinds
    alarms = [state for state in procedure.states if kinds[state.name] == "alarm"]
    if not alarms:
        yield 'a signal to stop: no state has kind = "alarm"'
    if not procedure.invariants:
        yield "what the states mean to the surgeon: there is no [[invariant]]"
    else:
        claimed = {
            name for invariant in procedure.invariants for name in (*invariant.states, *invariant.feels)
        }
        claimed |= {name for claim in procedure.temporal for name in claim.feels}
        for state in alarms:
            if not claimed & {state.name, state.feel}:
                yield f"{state.name}, an alarm: no [[invariant]] and no [[temporal]] says when it is felt"
    spoken_of = {name for one in procedure.invariants for name in (*one.forces, *one.never_forces)}
    for field in procedure.forces:
        if field.name not in spoken_of:
            yield f"when {field.name} pushes the hand: no [[invariant]] has it in forces or never_forces"
    if not any(claim.within_ms is not None for claim in procedure.temporal):
        yield "how soon an alarm is felt: there is no [[temporal]] claim with within_ms"


def _declared(procedure: Procedure) -> Iterator[str]:
    """Yield what the file declares to be meant, and what it leaves to be assumed."""
    kinds = procedure.kinds
    assumed = [f"{state.name} {kinds[state.name]}" for state in procedure.states if state.kind is None]
    if assumed:
        yield f"the kinds of states that do not say it, which are assumed: {', '.join(assumed)}"
    for relation in procedure.schema.relations:
        if relation.reason is not None:
            yield f"a threshold of {Triplet(*relation.names)} that no eye seems to allow: {relation.reason}"
    yield from _unlimited(procedure)
    for state in procedure.states:
        for alarm in state.may_delay:
            yield f"up to {state.hold_ms:g} ms in which {state.name} is held and {alarm} waits, as declared"


def _unlimited(procedure: Procedure) -> Iterator[str]:
    """Yield surfaces beyond which a state of success may be as far as it likes."""
    schema, kinds = procedure.schema, procedure.kinds
    limited = set[str]()
    for state in procedure.states:
        for relation in _needed_relations(procedure, state):
            name = schema.measure_name(relation)
            if relation.at_least is None and relation.above is None:
                if kinds[state.name] == "alarm" and len(state.when) == 1 and not state.unless:
                    limited.add(name)  # what is beyond is an alarm first
                is_surface = schema.entity(relation.object).geometry in ("polyline", "surface")
                if kinds[state.name] == "success" and is_surface and name not in limited:
                    beyond = f"how far beyond {relation.object} {state.name} may be"
                    yield f"{beyond}: distances there are negative"


def unreported(procedure: Procedure, reported: Collection[str]) -> dict[str, tuple[str, ...]]:
    """Return the states that no graph can reach, because their rules need entities that nobody reports.

    Args:
        procedure: A checked procedure.
        reported: Entities that the perceiver or the registration reports.

    Returns:
        By state: the entities that are missing.
    """
    phases = procedure.schema.phases
    there = {*reported, *phases, NEEDLE_3D, ROBOT_TIP}
    needed = {state.name: _needed(procedure, state) for state in procedure.states}
    return {
        name: missing
        for name, names in needed.items()
        if (missing := tuple(one for one in names if one not in there))
    }


def check_margins(procedure: Procedure, name: str, perceiver: PerceiverClass) -> None:
    """Check that a perceiver estimates the standard deviations that a procedure's margins need.

    Raises:
        BadInput: If it does not.
    """
    for relation in procedure.schema.relations:
        with_sd = perceiver.entities_with_sd | ({NEEDLE_3D} if perceiver.images == "eye" else set())
        if relation.margin_sd and relation.subject not in with_sd:
            problem = f"perceiver {name} estimates no standard deviation of {relation.subject}"
            raise BadInput(f"{procedure.name} has margin_sd, but {problem}; choose another of either")


def unreported_notes(procedure: Procedure, name: str, class_of: Callable[[str], PerceiverClass]) -> list[str]:
    """Return what to say before a run whose perceiver cannot see what its rules need; nothing if it can."""
    found = unreported(procedure, reported_with(class_of(name)))
    if not found:
        return []
    entities = ", ".join(dict.fromkeys(name for names in found.values() for name in names))
    kinds = procedure.kinds
    alarms = [name for name in found if kinds[name] == "alarm"]
    warning = f"; THE ALARM {', '.join(alarms)} CAN NEVER BE FELT" if alarms else ""
    return [
        f"perceiver {name} reports no {entities}, so these states of {procedure.name} cannot occur: "
        f"{', '.join(found)}{warning}"
    ]


def _needed_relations(procedure: Procedure, state: State) -> list[Relation]:
    """Return the relations without which a state's rule never fits, in the order of the schema."""
    relations = {relation.names: relation for relation in procedure.schema.relations}
    needed, todo = set[Names](), list(state.when)
    while todo:
        names = todo.pop()
        if names not in needed:
            needed.add(names)
            todo += relations[names].given
    return [relation for names, relation in relations.items() if names in needed]


def _needed(procedure: Procedure, state: State) -> tuple[str, ...]:
    """Return the entities without which a state's rule never fits, in the order of the schema."""
    needed = {name for relation in _needed_relations(procedure, state) for name in relation.names[::2]}
    return tuple(entity.name for entity in procedure.schema.entities if entity.name in needed)
