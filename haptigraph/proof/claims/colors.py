"""Claims about colours: an alarm never looks like success, silence or ignorance."""

from collections.abc import Iterator

from haptigraph.inference.color_vision import least_difference
from haptigraph.inference.colors import palette
from haptigraph.inference.procedure import Procedure
from haptigraph.proof.report import Claim, Violation

__all__ = ["color_claims"]

MIN_DIFFERENCE = 15.0
"""In CIELAB, where about 2 is just noticeable side by side."""


def color_claims(procedure: Procedure) -> list[Claim]:
    """Return the claims about the colours of a procedure's states."""
    statement = (
        "an alarm never has the colour of success, or of a silent or unseen state, whatever the colour vision"
    )
    return [Claim("colours", statement, tuple(_confused(procedure)))]


def _confused(procedure: Procedure) -> Iterator[Violation]:
    paints, kinds = palette(procedure), procedure.kinds
    others = [name for name in paints if kinds[name] not in ("alarm", "guidance")]
    for alarm in (name for name in paints if kinds[name] == "alarm"):
        for name in others:
            color, other = paints[alarm].color, paints[name].color
            if least_difference(color, other) < MIN_DIFFERENCE:
                sentence = (
                    f"the alarm {alarm!r} is {color}, and {name!r} ({kinds[name]}) is {other}, "
                    "which looks alike with some colour vision; give one another color"
                )
                yield Violation(sentence, f"state {alarm}")
