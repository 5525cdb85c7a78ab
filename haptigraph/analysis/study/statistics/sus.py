"""The System Usability Scale: from ten answers to a score, and what others' scores make of it.

Score: Brooke (1996), SUS: a quick and dirty usability scale. Grades and percentiles: the curved grading scale
of Sauro and Lewis (2016), Quantifying the User Experience, 2nd ed., from 241 studies. Adjectives: Bangor,
Kortum and Miller (2009), J. Usability Studies 4(3); the highest whose mean score is reached, as the paper
reads them.
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
    """Which share of the reference scores lies below, in percent."""


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
        ValueError: If there are not ten, or one is out of range.
    """
    if len(answers) != ITEMS or any(answer not in (1, 2, 3, 4, 5) for answer in answers):
        raise ValueError(f"SUS takes ten answers from 1 to 5, not {list(answers)}")
    return 2.5 * sum(
        answer - 1 if item % 2 == 0 else 5 - answer  # items 1, 3, ... praise; 2, 4, ... complain
        for item, answer in enumerate(answers)
    )


def grade(score: float) -> Grade:
    """Return the grade of a score, or of a mean of scores, rounded to one decimal as the scale is printed."""
    return next(each for each in GRADES if round(score, 1) >= each.from_score)


def adjective(score: float) -> str:
    """Return the word for a score, or for a mean of scores."""
    return next(word for least, word in ADJECTIVES if round(score, 1) >= least)


def sus_scores(answers: pd.DataFrame) -> pd.DataFrame:
    """Score every SUS in the answers of a study.

    An incomplete questionnaire has no score (NaN): nothing is filled in.

    Args:
        answers: The table of answers.

    Returns:
        participant, condition, position (where known), answered (items), sus.

    Raises:
        BadInput: If an item or an answer is none of SUS.
    """
    asked = answers[answers["questionnaire"].astype(str).str.lower() == "sus"]
    rows = []
    for (participant, condition), sheet in asked.groupby(["participant", "condition"], sort=True):
        who = f"SUS of {participant}, {condition}"
        given = {_whole(item, who, "item", ITEMS): answer for item, answer in _pairs(sheet)}
        if len(given) != len(sheet):
            raise BadInput("an item was answered twice", place=who)
        known = {item: _whole(answer, who, "answer", 5) for item, answer in given.items() if pd.notna(answer)}
        score = sus_score([known[item] for item in sorted(known)]) if len(known) == ITEMS else float("nan")
        position = sheet["position"].iloc[0] if "position" in sheet else float("nan")
        rows.append((participant, condition, position, len(known), score))
    return pd.DataFrame(rows, columns=["participant", "condition", "position", "answered", "sus"])


def _pairs(sheet: pd.DataFrame) -> list[tuple[object, object]]:
    return list(zip(sheet["item"], sheet["answer"], strict=True))


def _whole(value: object, who: str, what: str, largest: int) -> int:
    """Read a whole number from 1; an item may be called `sus_3` or `q3` as well as `3`."""
    text = str(value).strip()
    digits = text.lower().removeprefix("sus").lstrip("_q ") if what == "item" else text.removesuffix(".0")
    if not digits.isdigit() or not 1 <= int(digits) <= largest:
        raise BadInput(f"{what} {text!r} is none of 1 to {largest}", place=who)
    return int(digits)
