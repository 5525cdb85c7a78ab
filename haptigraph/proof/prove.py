"""Prove everything that is claimed of a procedure, by the house and by its author."""

from typing import Literal

from haptigraph.inference.procedure import Procedure
from haptigraph.proof.invariant_claims import invariant_claims
from haptigraph.proof.report import Proof
from haptigraph.proof.rules_claims import rules_claims
from haptigraph.proof.subject import Subject
from haptigraph.proof.threshold_claims import threshold_claims

__all__ = ["prove"]


def prove(procedure: Procedure, prover: Literal["auto", "exhaustive", "z3"] = "auto") -> Proof:
    """Hold every claim against every possible graph.

    Args:
        procedure: A checked procedure.
        prover: Who proves; auto: by looking at every graph where there are few, else z3.

    Raises:
        MissingExtra: If z3 is needed and not installed.
    """
    subject = Subject(procedure, prover)
    claims = (*rules_claims(subject), *threshold_claims(subject), *invariant_claims(subject))
    held_ms = {state.name: state.hold_ms for state in procedure.states if state.hold_ms}
    watched = tuple(claim.name for claim in procedure.temporal)
    return Proof(procedure.name, procedure.sha256, subject.prover.method, claims, watched, held_ms)
