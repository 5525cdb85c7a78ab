"""A study's protocol and progress as printable tables: conditions, plans, orders and participants."""

from collections import Counter
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, TypeAlias

from rich.table import Table

from haptigraph.analysis.words import counted
from haptigraph.study.frozen.analysis_plan import Analysis
from haptigraph.study.frozen.quality import quality_limits
from haptigraph.study.plan import Stage, conditions_of, inseparable
from haptigraph.study.protocol import Protocol

if TYPE_CHECKING:
    from haptigraph.study.status import ParticipantStatus

__all__ = ["planned_warning", "protocol_tables", "status_table"]


Plan: TypeAlias = Callable[[int], list[Stage]]
"""All stages of the participant in a slot."""


def protocol_tables(protocol: Protocol, plan: Plan, *, is_blind: bool = False) -> Iterator[Table]:
    """Yield the tables of conditions, the first plan, orders, targets, thresholds and the analysis.

    Args:
        protocol: The protocol.
        plan: Of every slot.
        is_blind: Whether to leave out who gets what: the plan and the orders.
    """
    table = _table("Conditions", "name", "title", "procedure", "touch", "display")
    for each in protocol.conditions:
        table.add_row(each.name, each.title, each.procedure, each.touch_text, each.display)
    yield table
    if not is_blind:
        yield from _assignments(protocol, plan)
    pairs = Counter((stage.target, stage.condition) for stage in _trials(protocol, plan))
    names = [each.name for each in protocol.conditions]
    table = _table("Trials by target and condition", "target", "mm along the retina", *names)
    for target in protocol.targets:
        counts = (str(pairs[target.name, name]) for name in names)
        table.add_row(target.name, f"{target.along_mm:+g}", *counts)
    yield table
    table = _table("Data quality", "a trial is flagged unless it has")
    for limit in quality_limits(protocol.quality) or ["(no thresholds)"]:
        table.add_row(limit)
    yield table
    if protocol.analysis is not None:
        yield _analysis_table(protocol.analysis)


def planned_warning(protocol: Protocol, plan: Plan) -> str:
    """Return a warning if no analysis can separate the effects of condition and target; empty if one can."""
    listed = inseparable((stage.condition, stage.target) for stage in _trials(protocol, plan))
    if not listed:
        return ""
    return (
        f"warning: condition and target cannot be separated: {listed}; an easy target would pass for a good "
        "condition. Plan more participants or trials.repetitions (with as many as targets, everyone gets "
        "each target under each condition)"
    )


def _trials(protocol: Protocol, plan: Plan) -> list[Stage]:
    slots = range(protocol.study.participants)
    return [stage for slot in slots for stage in plan(slot) if stage.kind == "trial"]


def _analysis_table(analysis: Analysis) -> Table:
    count = counted(analysis.min_trials, "valid trial")
    fewest = f", at least {count} under each condition" if analysis.min_trials else ""
    fewest += ", without trials beyond a threshold" if analysis.exclude_poor_trials else ""
    table = _table(
        f"Preregistered analysis (alpha {analysis.alpha:g}{fewest})",
        *("measure", "expected", "compared with", "family", "equivalent within"),
    )
    for each in analysis.hypotheses:
        bounds = analysis.equivalence.get(each.measure)
        table.add_row(
            each.measure,
            f"{each.second}: {each.expect}",
            each.first,
            "primary" if each.measure in analysis.primary else "other",
            f"{bounds[0]:g} to {bounds[1]:g}" if bounds else "",
        )
    return table


def _assignments(protocol: Protocol, plan: Plan) -> Iterator[Table]:
    table = _table("Plan of the first participant", "stage", "condition", "target", "timeout")
    for stage in plan(0):
        table.add_row(
            stage.key, stage.condition, stage.target, f"{stage.timeout_s:g} s" if stage.is_trial else ""
        )
    yield table
    count = protocol.study.participants
    orders = Counter(" > ".join(conditions_of(protocol, slot)) for slot in range(count))
    table = _table(
        f"Orders of {count} participants ({protocol.study.order}, seed {protocol.study.seed})", "order", ""
    )
    for order, times in sorted(orders.items()):
        table.add_row(order, str(times))
    yield table


def status_table(
    protocol: Protocol, participant_statuses: "list[ParticipantStatus]", *, is_blind: bool = False
) -> Table:
    """Return a table of all participants' progress; without orders if its reader is blinded."""
    left, size = sum(each.left for each in participant_statuses), protocol.study.participants
    withdrew = f", {left} withdrew" if left else ""
    table = _table(
        f"{protocol.study.title}: {len(participant_statuses) - left} of {size} participants{withdrew}",
        "participant",
        *(() if is_blind else ("order",)),
        "done",
        "next",
        "station",
        "void attempts",
    )
    for each in participant_statuses:
        order = () if is_blind else (each.order.replace(">", " > "),)
        done = f"{each.next.done} of {each.next.of}"
        table.add_row(
            each.participant, *order, done, _next(each, each.next.stage), each.station, str(each.void or "")
        )
    return table


def _next(status: "ParticipantStatus", stage: Stage | None) -> str:
    if stage is None:
        return status.next.ended
    return f"{stage.key} (running)" if status.next.running else stage.key


def _table(title: str, *headings: str) -> Table:
    table = Table(title=title, title_justify="left")
    for heading in headings:
        table.add_column(heading, overflow="fold")
    return table
