"""Evidence from proofs: every claim of `haptigraph check`, proved now."""

import shlex
from collections.abc import Iterator

from haptigraph.analysis.evaluation.origin import Origin
from haptigraph.analysis.evidence.case import Claim, Evidence
from haptigraph.analysis.evidence.hazards import GENERAL, hazard_of_invariant
from haptigraph.inference.procedure import Procedure
from haptigraph.proof.prove import prove
from haptigraph.proof.report import Claim as ProofClaim

__all__ = ["proof_claims"]


def proof_claims(procedure: Procedure, file: str, origin: Origin) -> Iterator[tuple[str, Claim]]:
    """Yield every claim about every possible graph, with its hazard and its proof.

    Args:
        procedure: A checked procedure.
        file: Its name on the command line.
        origin: Of the proofs.

    Raises:
        MissingExtra: If z3 is needed and not installed.
    """
    proof = prove(procedure)
    invariants = {invariant.name: invariant for invariant in procedure.invariants}
    for claim in proof.claims:
        invariant = invariants.get(claim.statement) if claim.name == "invariant" else None
        hazard = (
            GENERAL.get(claim.name, "undefined_rules")
            if invariant is None
            else hazard_of_invariant(procedure, invariant)
        )
        evidence = Evidence(
            "proof",
            "holds" if claim.holds else "fails",
            _figure(claim, proof.method),
            "no possible graph violates it",
            shlex.join(["haptigraph", "check", file]),
            file,
            procedure.sha256,
            origin.version,
            origin.commit,
            origin.made_utc,
        )
        yield hazard, Claim(claim.statement, (evidence,))


def _figure(claim: ProofClaim, method: str) -> str:
    if not claim.holds:
        more = f" (and {len(claim.violations) - 1} more)" if len(claim.violations) > 1 else ""
        return f"violated: {claim.violations[0].sentence}{more}"
    held = f"; not while held: {', '.join(claim.not_while_held)}" if claim.not_while_held else ""
    return f"{method}{held}"
