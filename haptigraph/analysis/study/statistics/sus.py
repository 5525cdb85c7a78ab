"""Grades and adjectives of scores of the System Usability Scale.

Grades and percentiles: the curved grading scale of Sauro and Lewis (2016), Quantifying the User Experience,
2nd ed., from 241 studies. Adjectives: Bangor, Kortum and Miller (2009), J. Usability Studies 4(3); the
highest whose mean score is reached, as in the paper.
"""

from msgspec import Struct

__all__ = ["Grade", "adjective", "grade"]


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


def grade(score: float) -> Grade:
    """Return the grade of a score or mean score, rounded to one decimal like the published scale."""
    return next(each for each in GRADES if round(score, 1) >= each.from_score)


def adjective(score: float) -> str:
    """Return the adjective for a score or mean score."""
    return next(adjective for minimum, adjective in ADJECTIVES if round(score, 1) >= minimum)
