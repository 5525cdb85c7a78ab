"""The System Usability Scale: scores, grades and adjectives.

Score: Brooke (1996), SUS: a quick and dirty usability scale. Grades and percentiles: the curved grading scale
of Sauro and Lewis (2016), Quantifying the User Experience, 2nd ed., from 241 studies. Adjectives: Bangor,
Kortum and Miller (2009), J. Usability Studies 4(3); the highest whose mean score is reached, as in the paper.
"""

from collections.abc import Sequence

import pandas as pd
from msgspec import Struct

from haptigraph.errors import BadInput

__all__ = ["Grade", "adjective", "grade", "sus_score", "sus_scores"]

ITEMS = 10


class Grade(Struct, frozen=True):
    """A step of the curved grading scale."""

    letter: str
    from_score: float
    percentiles: str
    """Range of percentile ranks among the reference scores."""


GRADES = (
    Grade("A+", 84.1, "96-100"),
    Grade("A", 80.8, "90-95"),
    Grade("A-", 78.9, "85-89"),
    Grade("B+", 77.2, "80-84"),
    Grade("B", 74.1, "70-79"),
    Grade("B-", 72.6, "65-69"),
    Grade("C+", 71.1, "60-64"),
    Grade("C", 65.0, "41-59"),
    Grade("C-", 62.7, "35-40"),
    Grade("D", 51.7, "15-34"),
    Grade("F", 0.0, "0-14"),
)
ADJECTIVES = (
    (90.9, "Best imaginable"),
    (85.5, "Excellent"),
    (71.4, "Good"),
    (50.9, "OK"),
    (35.7, "Poor"),
    (20.3, "Awful"),
    (0.0, "Worst imaginable"),
)


def sus_score(answers: Sequence[int]) -> float:
    """Return the score from 0 to 100.

    Args:
        answers: Of items 1 to 10, each from 1 (strongly disagree) to 5 (strongly agree).

    Raises:
        ValueError: If their number is not ten, or one is out of range.
    """
    if len(answers) != ITEMS or any(answer not in (1, 2, 3, 4, 5) for answer in answers):
        raise ValueError(f"SUS takes ten answers from 1 to 5, not {list(answers)}")
    return 2.5 * sum(
        answer - 1 if item % 2 == 0 else 5 - answer  # items 1, 3, ... are positive; 2, 4, ... negative
        for item, answer in enumerate(answers)
    )


def grade(score: float) -> Grade:
    """Return the grade of a score or mean score, rounded to one decimal like the published scale."""
    return next(each for each in GRADES if round(score, 1) >= each.from_score)


def adjective(score: float) -> str:
    """Return the adjective for a score or mean score."""
    return next(adjective for minimum, adjective in ADJECTIVES if round(score, 1) >= minimum)


def sus_scores(answers: pd.DataFrame) -> pd.DataFrame:
    """Score every SUS in the answers of a study.

    An incomplete questionnaire has no score (NaN); nothing is imputed.

    Args:
        answers: The table of answers.

    Returns:
        participant, condition, position (NaN if unknown), answered (items), sus.

    Raises:
        BadInput: If an item or an answer is not valid for the SUS.
    """
    answers = answers[answers["questionnaire"].astype(str).str.lower() == "sus"]
    rows = []
    for (participant, condition), group in answers.groupby(["participant", "condition"], sort=True):
        place = f"SUS of {participant}, {condition}"
        pairs = zip(group["item"], group["answer"], strict=True)
        given = {_integer(item, place, "item", ITEMS): answer for item, answer in pairs}
        if len(given) != len(group):
            raise BadInput("an item was answered twice", place=place)
        valid = {
            item: _integer(answer, place, "answer", 5) for item, answer in given.items() if pd.notna(answer)
        }
        score = sus_score([valid[item] for item in sorted(valid)]) if len(valid) == ITEMS else float("nan")
        position = group["position"].iloc[0] if "position" in group else float("nan")
        rows.append((participant, condition, position, len(valid), score))
    return pd.DataFrame(rows, columns=["participant", "condition", "position", "answered", "sus"])


def _integer(value: object, place: str, what: str, maximum: int) -> int:
    """Parse an integer from 1; items may be named `sus_3` or `q3` as well as `3`."""
    text = str(value).strip()
    digits = text.lower().removeprefix("sus").lstrip("_q ") if what == "item" else text.removesuffix(".0")
    if not digits.isdigit() or not 1 <= int(digits) <= maximum:
        raise BadInput(f"{what} {text!r} is not a number from 1 to {maximum}", place=place)
    return int(digits)
