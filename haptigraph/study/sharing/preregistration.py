"""Write the text of a preregistration from a protocol: design, sample, procedure, measures, analysis."""

import tomllib
from collections.abc import Iterator, Mapping
from typing import Any

from haptigraph.study.data_dictionary import MEASURES
from haptigraph.study.exchange.exporting import About
from haptigraph.study.preparation.calibration import Calibration
from haptigraph.study.protocol import FILE, Condition, Protocol

__all__ = ["preregistration"]

DESIGNS = {
    "within": "Within-subject: every participant completes all conditions.",
    "between": "Between-subject: every participant completes one condition.",
}
ORDERS = {
    "balanced": "balanced (rows of a Williams square, in random sequence)",
    "random": "random for each participant",
    "fixed": "fixed",
}
BLIND = {
    "nobody": "Nobody is blinded to the condition.",
    "participant": "The condition is hidden from the participant.",
    "everyone": "The condition is hidden from participant and experimenter.",
}
ANALYSIS = "analysis"
OUTPUTS = {
    "on": "haptic feedback",
    "sham": "sham haptic feedback (at random times, whatever the state)",
    "off": "no haptic feedback",
}


def preregistration(protocol: Protocol, about: About | None = None) -> str:
    """Return the text, in Markdown.

    Args:
        protocol: The protocol.
        about: The frozen study, whose date and SHA-256 the text states; None before the first participant.
    """
    text = about.parts[FILE] if about else protocol.parts[FILE]
    sha256 = about.protocol_sha256 if about else protocol.sha256
    when = (
        f"that the first participant froze in {about.frozen_utc}" if about else "before the first participant"
    )
    only = "that was registered before" if about else "it is registered before that participant comes"
    sections = {
        "Design": _design(protocol),
        "Conditions": [_condition(each) for each in protocol.conditions],
        "Sample": _sample(protocol),
        "Procedure": list(_procedure(protocol)),
        "Measures": _measures(protocol),
        "Analysis": list(_analysis(text)),
    }
    body = "\n\n".join(
        f"## {title}\n\n" + "\n".join(f"* {line}" for line in lines) for title, lines in sections.items()
    )
    return (
        f"# Preregistration: {about.title if about else protocol.study.title}\n\n"
        f"Generated from the protocol {when}. The SHA-256 of its texts is\n`{sha256}`.\n"
        f"This is a preregistration only if {only}.\n\n{body}\n"
    )


def _design(protocol: Protocol) -> list[str]:
    study = protocol.study
    what = "Order of conditions" if study.design == "within" else "Assignment of conditions"
    return [
        DESIGNS[study.design],
        f"{what}: {ORDERS[study.order]}; seed {study.seed}.",
        f"Order of targets, within each order of conditions: {protocol.trials.target_order}.",
        BLIND[study.blind],
    ]


def _condition(each: Condition) -> str:
    output = OUTPUTS[each.touch_text]
    return f"{each.title} (`{each.name}`): {output}, display `{each.display}`, procedure `{each.procedure}`."


def _sample(protocol: Protocol) -> list[str]:
    stop = protocol.stop
    rules = {
        f"{stop.timeouts_in_a_row} timeouts in a row": stop.timeouts_in_a_row,
        f"{stop.failed_trials} trials without a valid attempt": stop.failed_trials,
        f"{stop.session_min} minutes since the consent": stop.session_min,
    }
    active = [rule for rule, value in rules.items() if value]
    early = (
        f"A session ends early after {' or '.join(active)}." if active else "No rule ends a session early."
    )
    return [
        f"{protocol.study.participants} participants; whoever withdraws makes room for another one.",
        early,
    ]


def _procedure(protocol: Protocol) -> Iterator[str]:
    training, trials = protocol.training, protocol.trials
    if protocol.calibration is not None:
        yield _calibration(protocol.calibration)
    if training is None:
        yield "No training."
    else:
        when = (
            f"once, under `{training.condition}`" if training.condition else f"before the {training.before}"
        )
        until = f", until {_counted(training.until_hits, 'hit')} in a row" if training.until_hits else ""
        count = _counted(training.trials, "trial")
        yield f"Training {when}: {count} of up to {training.timeout_s:g} s{until}."
    blocks, repetitions = _counted(trials.blocks, "block"), _counted(trials.repetitions, "trial")
    yield (
        f"Under each condition {blocks} of {repetitions} of up to {trials.timeout_s:g} s; up to "
        f"{trials.attempts} attempts at one that is aborted or interrupted."
    )
    targets = ", ".join(f"`{each.name}` {each.along_mm:+g} mm" for each in protocol.targets)
    yield f"Targets, along the retina from its lowest point: {targets}."
    for table, each in protocol.questionnaires:
        when = {"start": "first", "condition": "after each condition", "end": "last"}[table.when]
        yield f"Questionnaire “{each.title}” ({_counted(len(each.items), 'item')}), {when}."


def _calibration(calibration: Calibration) -> str:
    parts = []
    if calibration.stimuli:
        parts.append(f"the detection threshold of vibration from {calibration.stimuli} stimuli")
    if calibration.presentations:
        rounds = f", at most {calibration.max_rounds} rounds" if calibration.max_rounds > 1 else ""
        parts.append(f"the naming of every pattern, {calibration.presentations} times each{rounds}")
    strength = calibration.times_threshold
    use = f" The weakest pattern has {strength:g} times the threshold." if strength else ""
    return f"Calibration, for each participant and device: {'; '.join(parts)}.{use}"


def _counted(count: int, what: str) -> str:
    return f"{count} {what}" if count == 1 else f"{count} {what}s"


def _measures(protocol: Protocol) -> list[str]:
    measured = [
        f"`{each.name}`{f' [{each.unit}]' if each.unit else ''}: {each.meaning}." for each in MEASURES
    ]
    return [*measured, "`time_<state>_s` [s]: time in each state of the procedure in a run."]


def _analysis(text: str) -> Iterator[str]:
    """Yield what the protocol's table of the analysis fixes, whatever its keys."""
    table = tomllib.loads(text).get(ANALYSIS)
    if not table:
        yield f"The protocol has no [{ANALYSIS}] table: it fixes no hypothesis; the analysis is exploratory."
        return
    yield from _stated(table)


def _stated(table: Mapping[str, Any], of: str = "") -> Iterator[str]:
    for key, value in table.items():
        name = f"{of}{key.replace('_', ' ')}"
        if isinstance(value, Mapping):
            yield from _stated(value, f"{name}: ")
        elif isinstance(value, list) and value and all(isinstance(each, Mapping) for each in value):
            for number, each in enumerate(value, 1):
                yield from _stated(each, f"{name} {number}: ")
        elif isinstance(value, list):
            yield f"{name}: {', '.join(map(str, value)) or 'none'}"
        else:
            yield f"{name}: {value}"
