"""Evidence from the accuracy of perception: results of `haptigraph evaluate --json`, and their bars."""

import operator
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import msgspec
from msgspec import Struct

from haptigraph.analysis.evaluation.origin import Origin
from haptigraph.analysis.evidence.case import MIN_TRIALS, Claim, Evidence, Status
from haptigraph.analysis.evidence.files import standing
from haptigraph.checksum import sha256_of
from haptigraph.errors import BadInput

__all__ = ["BARS", "Bar", "accuracy_claims"]

COMMAND = "haptigraph evaluate --simulated 66 --perceiver tracker --json"


class Bar(Struct, frozen=True):
    """What a score must reach."""

    hazard: str
    statement: str
    score: str
    """Path in the scores: "tip_z.p95"."""
    at_most: float | None = None
    at_least: float | None = None
    of: str = ""
    """The score that counts the images of which this one counts some; without any it is not exercised."""
    least: int = 0
    """How many of these it takes, in all results together."""
    share: bool = False
    """Whether the bar is about the share of these images."""

    @property
    def text(self) -> str:
        """The bar in words."""
        what = f"{self.score} / {self.of}" if self.share else self.score
        least = f", {self.of} >= {self.least}" if self.least else ""
        sign, bound = ("<=", self.at_most) if self.at_most is not None else (">=", self.at_least)
        return f"{what} {sign} {bound:g}{least}"


BARS = (
    Bar(
        "missed_alarm",
        "No contact passes as something else",
        "missed_contact_images",
        at_most=0,
        of="contact_images",
        least=MIN_TRIALS,
    ),
    Bar("false_alarm", "No contact is reported where there is none", "wrong_contact_images", at_most=0),
    Bar(
        "silent_failure",
        "A needle that is visible in the eye is detected",
        "detection_rate",
        at_least=0.95,
    ),
    Bar(
        "silent_failure",
        "Where no needle is, none is reported",
        "false_detections",
        at_most=0.001,
        of="images",
        share=True,
    ),
    Bar(
        "wrong_certainty",
        "Few reported tips are more than 0.3 mm from the true one",
        "tip_far_rate",
        at_most=0.01,
    ),
    Bar(
        "wrong_certainty",
        "68 % of the tips are within one reported standard deviation",
        "tip_z.p68",
        at_most=1,
    ),
    Bar(
        "wrong_certainty",
        "95 % of the tips are within two reported standard deviations",
        "tip_z.p95",
        at_most=2,
    ),
    Bar(
        "wrong_guidance",
        "The angle of a needle deeper than 3 mm is right within half a degree in 95 % of the images",
        "angle_error_deg.deep.p95",
        at_most=0.5,
    ),
    Bar(
        "wrong_guidance",
        "The state agrees with the true one, away from transitions",
        "state_agreement",
        at_least=0.95,
    ),
)
"""Chosen by the project, not by a standard: contacts may not be missed; standard deviations are what they are
called; the angle is to a third of the 1.7 degrees that count as aligned; detection and agreement are a floor
below what docs/explanation/accuracy.md measures."""


def accuracy_claims(
    paths: Sequence[str | Path], origin: Origin, perceiver: str
) -> Iterator[tuple[str, Claim]]:
    """Yield the claim about each score, with its hazard and what the evaluations found.

    Args:
        paths: Results of evaluations.
        origin: The software and the procedure that they must be about.
        perceiver: The procedure's own; of an evaluation of several, its scores count.

    Raises:
        BadInput: If a file is not a result of an evaluation.
    """
    results = [(path, *_read(path, perceiver)) for path in paths]
    for bar in BARS:
        counts = [_score(scores, bar.of) for _, made, scores in results if not standing(made, origin)]
        total = sum(count for count in counts if count is not None)
        evidence = [_evidence(path, made, scores, bar, total, origin) for path, made, scores in results]
        missing = Evidence(
            "accuracy", "missing", "no accuracy; give results with --evaluation", bar.text, COMMAND
        )
        yield bar.hazard, Claim(bar.statement, tuple(evidence or [missing]))


def _read(path: str | Path, perceiver: str) -> tuple[Origin | None, dict[str, Any]]:
    """Return what made a result, and the scores of one perceiver with its name."""
    try:
        result = msgspec.json.decode(Path(path).read_bytes(), type=dict[str, Any])
        made = msgspec.convert(result["origin"], Origin) if "origin" in result else None
        if "detection_rate" in result:
            return made, result
        if "perceivers" not in result:
            raise BadInput("not a result of `haptigraph evaluate --json` (it has no scores)", path)
        by_name = msgspec.convert(result["perceivers"], dict[str, dict[str, dict[str, Any]]])
    except msgspec.DecodeError as error:
        raise BadInput(f"not a result of `haptigraph evaluate --json` ({error})", path) from None
    name = next(iter(by_name)) if len(by_name) == 1 else perceiver
    if "all" not in by_name.get(name, {}):
        raise BadInput(f"has no scores of perceiver {name!r}; found: {', '.join(by_name)}", path)
    return made, {**by_name[name]["all"], "perceiver": name}


def _evidence(
    path: str | Path, made: Origin | None, scores: dict[str, Any], bar: Bar, total: float, origin: Origin
) -> Evidence:
    status, figure = _judged(scores, bar, total)
    refusal = standing(made, origin)
    if refusal is not None:
        status, reason = refusal
        figure = f"{reason}, so it does not count: {figure}"
    return Evidence(
        *("accuracy", status, figure, bar.text, made.command if made else COMMAND, str(path)),
        *(sha256_of(path), *((made.version, made.commit, made.made_utc) if made else ())),
    )


def _judged(scores: dict[str, Any], bar: Bar, total: float) -> tuple[Status, str]:
    value, count = _score(scores, bar.score), _score(scores, bar.of) if bar.of else None
    about = f"{scores.get('perceiver', '?')}, {scores.get('clip', 'simulated scenes')}"
    if value is None:
        return "missing", f"{bar.score} was not measured ({about})"
    figure = f"{bar.score} {value:.3g}" + (f" of {count:g}" if count is not None else "")
    if bar.of and not count:
        return "not exercised", f"{bar.score}: no {bar.of.replace('_', ' ')} to judge by ({about})"
    measured = value / count if bar.share and count else value
    holds = _compare(measured, bar)
    figure = f"{figure} ({about}, {scores.get('images')} images)"
    if holds and total < bar.least:
        return "incomplete", f"{figure}; {total:g} {bar.of.replace('_', ' ')} in all results"
    return ("holds" if holds else "fails"), figure


def _compare(value: float, bar: Bar) -> bool:
    compare: Callable[[float, float], bool] = operator.le if bar.at_most is not None else operator.ge
    bound = bar.at_most if bar.at_most is not None else bar.at_least
    return bound is not None and compare(value, bound)


def _score(scores: dict[str, Any], name: str) -> float | None:
    value: Any = scores
    for part in name.split("."):
        value = value.get(part) if isinstance(value, dict) else None
    return float(value) if isinstance(value, int | float) and not isinstance(value, bool) else None
