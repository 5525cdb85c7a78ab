import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptigraph.errors import BadInput
from haptigraph.study.questionnaire import load_questionnaire, parse_questionnaire

HEAD = '[questionnaire]\nname = "own"\ntitle = "Our own"\n'
ITEMS = "".join(
    f'\n[[item]]\nkey = "{key}"\ntext = "?"\nkind = "{kind}"\n{bounds}'
    for key, kind, bounds in (
        ("a", "scale", "low = 1\nhigh = 7\n"),
        ("b", "scale", "low = 1\nhigh = 7\n"),
        ("c", "number", "low = 0\nhigh = 10\n"),
        ("free", "number", "low = 0\n"),
        ("why", "text", ""),
    )
)


def own(score: str, items: str = ITEMS):
    return parse_questionnaire(f"{HEAD}\n[score]\n{score}\n{items}", "own.toml")


def scores(score: str, **answers: float) -> dict[str, float]:
    return own(score).scores(answers)


@pytest.mark.parametrize(
    ("score", "expected", "ends"),
    [
        ('method = "sum"', 5 + 2 + 4, (2, 24)),
        ('method = "mean"', 11 / 3, (2 / 3, 8)),
        ('method = "mean"\nitems = ["a", "b"]', 3.5, (1, 7)),
        ('method = "sum"\nitems = ["a", "b"]\nreversed = ["b"]', 5 + 6, (2, 14)),
        ('method = "mean"\nitems = ["a", "b"]\nweights = { a = 3 }', (15 + 2) / 4, (1, 7)),
        ('method = "sum"\nitems = ["a", "b"]\nweights = { a = 3 }', 17, (4, 28)),
        ('method = "sum"\nitems = ["a", "b"]\nrange = [0, 100]', 100 * 5 / 12, (0, 100)),
        (
            'method = "mean"\nitems = ["a", "b"]\nrange = [-1, 1]\nweights = { a = 3 }',
            -1 + 2 * 13 / 24,
            (-1, 1),
        ),
    ],
)
def test_a_score_is_what_its_table_says(score, expected, ends):
    assert scores(score, a=5, b=2, c=4)["own"] == pytest.approx(expected)
    (scale,) = own(score).scales
    assert (scale.low, scale.high) == pytest.approx(ends) and scale.title == "Our own"


def test_subscales_are_scores_of_their_own():
    table = 'method = "mean"\ntitle = "All"\n\n[[score.subscale]]\nname = "ab"\ntitle = "A and B"\nitems = ["a", "b"]'
    assert scores(table, a=1, b=7, c=10) == {"own": pytest.approx(6), "own_ab": 4}
    assert [(scale.name, scale.title) for scale in own(table).scales] == [
        ("own", "All"),
        ("own_ab", "A and B"),
    ]
    partial = scores(table, a=1, b=7)
    assert math.isnan(partial["own"]) and partial["own_ab"] == 4


@given(
    st.integers(1, 7), st.integers(1, 7), st.floats(0, 10), st.sampled_from(["sum", "mean"]), st.booleans()
)
def test_a_score_is_within_its_ends(a, b, c, method, rescaled):
    table = f'method = "{method}"\nreversed = ["a"]\nweights = {{ c = 0.5 }}\n' + "range = [0, 1]" * rescaled
    (scale,) = own(table).scales
    (value,) = scores(table, a=a, b=b, c=c).values()
    assert scale.low - 1e-9 <= value <= scale.high + 1e-9


@pytest.mark.parametrize(
    ("score", "problem"),
    [
        ('method = "median"', "line 6: unknown method 'median'; did you mean 'mean'"),
        ('method = "sum"\nitems = ["d"]', "line 7: unknown item with low and high 'd'; valid: a, b, c"),
        ('method = "sum"\nreversed = ["why"]', "line 7: unknown item with low and high 'why'"),
        ('method = "sum"\nitems = ["a", "a"]', "line 7: item 'a' occurs twice"),
        ('method = "sum"\nweights = { free = 2 }', "line 7: unknown item with low and high 'free'"),
        ('method = "sum"\nweights = { a = 0 }', "line 7: score.weights"),
        (
            'method = "sum"\nrange = [100, 0]',
            r"line 7: range: expected the lowest and the highest score, found",
        ),
        (
            'method = "sum"\n[[score.subscale]]\nname = "x"\ntitle = "X"\nitems = ["z"]',
            "line 10: unknown item with low and high 'z'",
        ),
        (
            'method = "sum"\n[[score.subscale]]\nname = "x"\ntitle = "X"\nitems = []',
            "line 10: a subscale without",
        ),
        (
            'method = "sum"' + '\n[[score.subscale]]\nname = "x"\ntitle = "X"\nitems = ["a"]' * 2,
            "two subscales of the same name",
        ),
    ],
)
def test_an_invalid_score_is_refused_with_its_line(score, problem):
    with pytest.raises(BadInput, match=rf"own\.toml, {problem}" if problem.startswith("line") else problem):
        own(score)


def test_a_score_without_items_that_have_bounds_is_refused():
    text = '\n[[item]]\nkey = "why"\ntext = "?"\nkind = "text"\n'
    with pytest.raises(BadInput, match="no item has low and high"):
        own('method = "sum"', text)


def test_the_nasa_tlx_ships_with_its_anchors():
    tlx = load_questionnaire("nasa_tlx")
    assert {(item.kind, item.low, item.high) for item in tlx.items} == {("scale", 0, 20)}  # 21 steps
    anchors = {item.key: (item.low_label, item.high_label) for item in tlx.items}
    assert anchors.pop("performance") == ("Perfect", "Failure")
    assert set(anchors.values()) == {("Very low", "Very high")} and len(anchors) == 5
    assert tlx.items[0].text == "Mental Demand: How mentally demanding was the task?"
