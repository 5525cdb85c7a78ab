"""Prove the general claims about every procedure and those that its author makes."""

from typing import Literal

from haptigraph.inference.procedure import Procedure
from haptigraph.messages import Capabilities
from haptigraph.proof.color_claims import color_claims
from haptigraph.proof.haptic.follow_claims import follow_claims
from haptigraph.proof.haptic.haptic_claims import device_claims, haptic_claims
from haptigraph.proof.invariant_claims import invariant_claims
from haptigraph.proof.report import Proof
from haptigraph.proof.rules_claims import rules_claims
from haptigraph.proof.subject import Subject
from haptigraph.proof.threshold_claims import threshold_claims

__all__ = ["prove"]


def prove(
    procedure: Procedure,
    prover: Literal["auto", "exhaustive", "z3"] = "auto",
    device: tuple[str, Capabilities] | None = None,
) -> Proof:
    """Check every claim against every possible graph.

    Args:
        procedure: A checked procedure.
        prover: The method; auto: enumerate the graphs if there are few, else z3.
        device: Name and capabilities of a device that is to play the haptic grammar.

    Raises:
        MissingExtra: If z3 is needed and not installed.
    """
    subject = Subject(procedure, prover)
    claims = (
        *rules_claims(subject),
        *threshold_claims(subject),
        *invariant_claims(subject),
        *haptic_claims(procedure),
        *follow_claims(procedure),
        *color_claims(procedure),
        *(device_claims(procedure, *device) if device else ()),
    )
    held_ms = {state.name: state.hold_ms for state in procedure.states if state.hold_ms}
    temporal = tuple(claim.name for claim in procedure.temporal)
    return Proof(procedure.name, procedure.sha256, subject.prover.method, claims, temporal, held_ms)
