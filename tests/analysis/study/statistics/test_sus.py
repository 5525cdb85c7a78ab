import pytest

from haptigraph.analysis.study.statistics.sus import adjective, grade


@pytest.mark.parametrize(
    ("score", "letter", "percentiles"),
    [
        (84.1, "A+", "96-100"),
        (81.9, "A", "90-95"),
        (80.75, "A", "90-95"),  # rounded to 80.8
        (75.9, "B", "70-79"),
        (68.0, "C", "41-59"),
        (51.6, "F", "0-14"),
        (0.0, "F", "0-14"),
    ],
)
def test_grades_agree_with_sauro_and_lewis(score, letter, percentiles):
    assert (grade(score).letter, grade(score).percentiles) == (letter, percentiles)


def test_adjectives_agree_with_the_paper():
    assert adjective(81.9) == "Good"  # the paper, section IV
    assert adjective(85.5) == "Excellent" and adjective(12.0) == "Worst imaginable"
