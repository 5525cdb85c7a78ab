import pandas as pd
import pytest

from haptigraph.analysis.study.statistics.sus import adjective, grade, sus_score, sus_scores
from haptigraph.errors import BadInput

BROOKE = [5, 4, 2, 1, 2, 3, 2, 4, 5, 2]  # the worked example of Brooke (1996): 22 * 2.5 = 55


def test_the_score_agrees_with_brookes_worked_example():
    assert sus_score(BROOKE) == 55.0


@pytest.mark.parametrize(("answers", "score"), [([5, 1] * 5, 100), ([1, 5] * 5, 0), ([3] * 10, 50)])
def test_extreme_and_neutral_answers_have_extreme_and_middle_scores(answers, score):
    assert sus_score(answers) == score


@pytest.mark.parametrize("answers", [[3] * 9, [0] + [3] * 9, [6] + [3] * 9])
def test_invalid_answers_are_refused(answers):
    with pytest.raises(ValueError, match="ten answers from 1 to 5"):
        sus_score(answers)


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


def sus(answers, participant="P1"):
    items = range(1, len(answers) + 1)
    return pd.DataFrame(
        {
            "participant": participant,
            "condition": "a",
            "position": 1,
            "questionnaire": "sus",
            "item": items,
            "answer": answers,
        }
    )


def test_incomplete_questionnaires_have_no_score():
    scores = sus_scores(pd.concat([sus(BROOKE), sus(BROOKE[:9], "P2"), sus([*BROOKE[:9], None], "P3")]))
    assert scores["sus"].tolist()[0] == 55.0 and scores["sus"].isna().tolist() == [False, True, True]
    assert scores["answered"].tolist() == [10, 9, 9]


@pytest.mark.parametrize("answer", ["7", "often"])
def test_an_answer_out_of_range_is_refused(answer):
    with pytest.raises(BadInput, match=rf"SUS of P1, a: answer '{answer}' is not a number from 1 to 5"):
        sus_scores(sus([answer, *BROOKE[1:]]))


def test_items_may_have_a_prefix():
    table = sus(BROOKE)
    table["item"] = [f"sus_{item}" for item in table["item"]]
    assert sus_scores(table)["sus"].tolist() == [55.0]
