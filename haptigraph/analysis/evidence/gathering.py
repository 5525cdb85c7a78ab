"""Gather all evidence about a procedure: proofs made now, and files of results -> a safety case."""

from collections.abc import Iterator, Sequence
from pathlib import Path

from msgspec import Struct

from haptigraph.analysis.evaluation.origin import Origin, new_origin
from haptigraph.analysis.evidence.accuracy_evidence import accuracy_claims
from haptigraph.analysis.evidence.case import Claim, Evidence, HazardCase, SafetyCase
from haptigraph.analysis.evidence.fault_evidence import fault_claims
from haptigraph.analysis.evidence.hazards import HAZARDS, Hazard
from haptigraph.analysis.evidence.proof_evidence import proof_claims
from haptigraph.analysis.evidence.run_evidence import run_claims
from haptigraph.assemble import load_procedure, perceiver_name
from haptigraph.config import Config
from haptigraph.inference.procedure import Procedure
from haptigraph.recording.writer import Progress

__all__ = ["Results", "safety_case"]


class Results(Struct, frozen=True):
    """Files of results."""

    faults: str | Path | None = None
    evaluations: Sequence[str | Path] = ()
    runs: Sequence[str | Path] = ()


def safety_case(name: str, results: Results, progress: Progress | None = None) -> SafetyCase:
    """Prove a procedure's claims, read results, and sort all by hazard.

    Args:
        name: The procedure: a shipped one, or a file.
        results: Files of results.
        progress: Called with the progress.

    Raises:
        BadInput: If the procedure or a file cannot be used.
        MissingExtra: If z3 is needed and not installed.
    """
    procedure = load_procedure(name)
    origin = new_origin(procedure)
    claims: dict[str, list[Claim]] = {hazard.key: [] for hazard in HAZARDS}
    for key, claim in _claims(procedure, name, origin, results, progress):
        claims[key].append(claim)
    hazards = tuple(
        HazardCase(hazard.title, hazard.harm, tuple(_with_missing(hazard, claims[hazard.key], name)))
        for hazard in HAZARDS
    )
    return SafetyCase(procedure.title, name, origin, hazards)


def _claims(
    procedure: Procedure, name: str, origin: Origin, results: Results, progress: Progress | None
) -> Iterator[tuple[str, Claim]]:
    yield from proof_claims(procedure, name, origin)
    yield from run_claims(results.runs, procedure, origin, progress)
    yield from accuracy_claims(results.evaluations, origin, perceiver_name(Config(), procedure))
    yield from fault_claims(results.faults, origin)


def _with_missing(hazard: Hazard, claims: list[Claim], name: str) -> list[Claim]:
    """Return the claims about a hazard, and the one that the procedure should make but does not."""
    sources = {each.source for claim in claims for each in claim.evidence}
    if not hazard.needs or hazard.source in sources:
        return claims
    problem = f"the procedure does not claim it; add {hazard.needs}"
    missing = Evidence(hazard.source, "missing", problem, hazard.needs, "", name)
    return [Claim(f"The procedure has {hazard.needs}", (missing,)), *claims]
