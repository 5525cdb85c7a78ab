"""The claim that the perceiver of a run reports what alarms need."""

from haptigraph.inference.coverage import reported_with, unreported
from haptigraph.inference.procedure import Procedure
from haptigraph.proof.report import Claim, Violation
from haptigraph.stages import PerceiverClass

__all__ = ["reported_claim"]


def reported_claim(
    procedure: Procedure, name: str, perceiver: PerceiverClass
) -> tuple[Claim, tuple[str, ...]]:
    """Return the claim that alarms can occur with a perceiver, and phrases about other states that cannot.

    Args:
        procedure: A checked procedure.
        name: Of the perceiver.
        perceiver: Its class, which says what it reports.
    """
    kinds = procedure.kinds
    missing = unreported(procedure, reported_with(perceiver))
    fixed = [one.name for one in procedure.schema.entities if one.fixed and one.name in perceiver.entities]
    sentences = {
        state: f"{state} cannot occur: perceiver {name} reports no {', '.join(names)}"
        for state, names in missing.items()
    }
    violations = [
        Violation(sentence, f"state {state}")
        for state, sentence in sentences.items()
        if kinds[state] == "alarm"
    ]
    violations += [
        Violation(f"{one} is fixed, but {name} may lose it from sight; remove fixed", f"entity {one}")
        for one in fixed
    ]
    others = tuple(sentence for state, sentence in sentences.items() if kinds[state] != "alarm")
    return Claim("reported", f"perceiver {name} reports what every alarm needs", tuple(violations)), others
