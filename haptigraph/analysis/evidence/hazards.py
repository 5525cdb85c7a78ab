"""The hazards of haptic guidance by pictures, and which claims concern which of them."""

from msgspec import Struct

from haptigraph.analysis.evidence.case import Source
from haptigraph.inference.claims import Invariant, Temporal
from haptigraph.inference.meaning import Kind
from haptigraph.inference.procedure import Procedure

__all__ = ["FAULTS", "GENERAL", "HAZARDS", "Hazard", "hazard_of_invariant", "hazard_of_temporal"]


class Hazard(Struct, frozen=True):
    """What may go wrong."""

    key: str
    title: str
    harm: str
    needs: str = ""
    """What a procedure has to claim about it; empty if nothing depends on the procedure."""
    source: Source = "proof"
    """Where the evidence for that claim comes from."""


HAZARDS = (
    Hazard(
        "missed_alarm",
        "Contact at a wrong place raises no alarm",
        "the tip injures tissue, and the hand that moves it feels nothing",
        "an [[invariant]] that a state of kind alarm is felt",
    ),
    Hazard(
        "false_alarm",
        "An alarm is raised without its cause",
        "the surgeon withdraws without need, and trusts later alarms less",
        "an [[invariant]] that an alarm is felt nowhere else",
    ),
    Hazard(
        "false_success",
        "Success is felt at a wrong place, or not at the target",
        "the operation goes on at a place that is not the target",
    ),
    Hazard(
        "late_alarm",
        "The alarm is late",
        "the tip moves on before the hand can stop it",
        "a [[temporal]] claim that an alarm is felt within a time",
        "runs",
    ),
    Hazard(
        "stuck_vibration",
        "A vibration outlasts its cause, or never ends",
        "the vibration says what is no longer true, and disturbs the hand",
        "a [[temporal]] claim that silence follows within a time",
        "runs",
    ),
    Hazard(
        "silent_failure",
        "Perception fails, and nobody notices",
        "silence is taken for safety although nothing is known",
        "an [[invariant]] about what is felt while the tip is not seen",
    ),
    Hazard(
        "wrong_certainty",
        "A position is reported as more certain than it is",
        "margins are too small, and contact is excluded where it is possible",
    ),
    Hazard(
        "wrong_guidance",
        "Guidance misleads",
        "the surgeon is guided away from the target, or is confused by many changes",
        "an [[invariant]] about states of kind guidance or neutral",
    ),
    Hazard(
        "wrong_registration",
        "Registration or procedure do not fit the eye",
        "every distance is wrong, and each alarm with it",
    ),
    Hazard(
        "lost_record",
        "A recording is lost or altered unnoticed",
        "what happened cannot be established afterwards, or is established wrongly",
    ),
    Hazard(
        "interference",
        "Somebody else on the network disturbs or steers a run",
        "the vibration is not that of the rules",
    ),
    Hazard(
        "uncommanded_motion",
        "A robot moves on after a fault, or starts by itself",
        "the instrument moves in the eye without a hand that wants it",
    ),
    Hazard(
        "uncommanded_force",
        "A force device pushes on after a fault, or starts by itself",
        "the hand is pushed where nobody wants it, and the instrument with it",
    ),
    Hazard(
        "undefined_rules",
        "A situation has no rule, or not the intended one",
        "what is felt then is accidental",
    ),
)

GENERAL = {
    "alarm felt": "missed_alarm",
    "alarm strongest": "missed_alarm",
    "alarm unlike": "missed_alarm",
    "aimed": "wrong_guidance",
    "prompt": "late_alarm",
    "waiting": "late_alarm",
    "consistent": "late_alarm",
    "colours": "wrong_guidance",
    "felt": "wrong_guidance",
    "follow grows": "wrong_guidance",
    "follow felt": "wrong_guidance",
    "force unseen": "wrong_guidance",
}
"""Hazards of the claims that are proved of every procedure, by the claim's name; others: undefined_rules."""

FAULTS = {
    "hung process": ("stuck_vibration", "A process that hangs does not keep the actuator vibrating"),
    "ended run": ("stuck_vibration", "However a run ends, the actuator is silent afterwards"),
    "driver chip": (
        "stuck_vibration",
        "Whatever fails on the way to a driver chip, its motor is silent in time",
    ),
    "driver chip, restarts": (
        "stuck_vibration",
        "A driver chip's motor is silent once its process or board has started again",
    ),
    "slow connection": ("late_alarm", "Over a slow connection, no image is felt after its time"),
    "raw images over ROS 2": ("late_alarm", "Images over ROS 2 arrive, or their loss is reported"),
    "damaged file": ("wrong_registration", "A damaged file is refused, with one sentence"),
    "recover": ("lost_record", "Recovery saves what can be read, and reports every loss"),
    "replay of a complete file": ("lost_record", "A changed recording is not replayed as if it were whole"),
    "replay of a journal": ("lost_record", "A changed journal is not replayed as if it were whole"),
    "meddled recording": ("lost_record", "A recording that is meddled with during the run is reported"),
    "full disk": ("lost_record", "A full disk is reported, and what was written can be read"),
    "schemas and normal ends": ("lost_record", "A run that ends normally leaves a complete recording"),
    "half-open connections": ("interference", "Visitors that block connections do not disturb the actuator"),
    "foreign requests": ("interference", "Requests of other origins are refused"),
    "killed or hung robot process": (
        "uncommanded_motion",
        "A robot whose processes die or hang is held, and does not start again by itself",
    ),
    "force on the hand": (
        "uncommanded_force",
        "A hand on a force device is let go when the run, the process or the device fails",
    ),
}
"""Hazard and claim of each kind of faults in a campaign."""


def hazard_of_invariant(procedure: Procedure, invariant: Invariant) -> str:
    """Return the hazard of an invariant: by the kinds of the states that it requires or excludes."""
    kinds, felt = procedure.kinds, {state.name: state.feel for state in procedure.states}

    def kinds_of(states: tuple[str, ...], patterns: tuple[str, ...]) -> set[Kind]:
        return {kinds[name] for name, feel in felt.items() if name in states or feel in patterns}

    required = kinds_of(invariant.states, () if invariant.states else invariant.feels)
    excluded = kinds_of(invariant.never_states, invariant.never_feels)
    if not invariant.states and not invariant.absent:
        required.discard("unseen")  # silence that also the states have in which nothing is seen
    for kind, hazard in (
        ("alarm", "missed_alarm"),
        ("success", "false_success"),
        ("unseen", "silent_failure"),
    ):
        if kind in required:
            return hazard
    for kind, hazard in (
        ("alarm", "false_alarm"),
        ("success", "false_success"),
        ("unseen", "silent_failure"),
    ):
        if kind in excluded and not required:
            return hazard
    return "wrong_guidance"


def hazard_of_temporal(procedure: Procedure, claim: Temporal) -> str:
    """Return the hazard that a temporal claim concerns: by the kinds of the states that feel its pattern."""
    if claim.within_ms is None:
        return "wrong_guidance"
    silent = {pattern.name for pattern in procedure.patterns if pattern.kind == "off"}
    if silent.issuperset(claim.feels):
        return "stuck_vibration"
    kinds = {procedure.kinds[state.name] for state in procedure.states if state.feel in claim.feels}
    return "silent_failure" if kinds == {"unseen"} else "late_alarm"
