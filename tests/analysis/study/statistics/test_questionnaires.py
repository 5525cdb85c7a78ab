import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st
from study_tables import PROTOCOL, freeze, simulated_study, write_study

from haptigraph.analysis.study.detail_tables import detail_tables
from haptigraph.analysis.study.figures.questionnaires import questionnaire_figure
from haptigraph.analysis.study.figures.style import styled
from haptigraph.analysis.study.results import AnalysisPlan, analyse
from haptigraph.analysis.study.results_table import result_tables
from haptigraph.analysis.study.statistics.questionnaires import score_questionnaire, scored_questionnaires
from haptigraph.analysis.study.tables import read_tables
from haptigraph.analysis.study.traces import read_traces
from haptigraph.analysis.study.writing.methods import methods
from haptigraph.errors import BadInput
from haptigraph.study.questionnaire import load_questionnaire, parse_questionnaire

BROOKE = [5, 4, 2, 1, 2, 3, 2, 4, 5, 2]  # the worked example of Brooke (1996): 22 * 2.5 = 55
SUS = load_questionnaire("sus")
TLX = load_questionnaire("nasa_tlx")
TRUST = """
[questionnaire]
name = "trust"
title = "Trust"

[[item]]
key = "q1"
text = "I trust it."
kind = "scale"
low = 1
high = 7

[[item]]
key = "why"
text = "Why?"
kind = "text"
required = false
"""


def sheet(answers, participant="P1", name="sus", items=None):
    items = items or range(1, len(answers) + 1)
    columns = {"participant": participant, "condition": "a", "position": 1, "questionnaire": name}
    return pd.DataFrame({**columns, "item": items, "answer": answers})


def test_the_score_of_the_sus_agrees_with_brookes_worked_example():
    assert score_questionnaire(sheet(BROOKE), SUS)["sus"].tolist() == [55.0]


@given(st.lists(st.integers(1, 5), min_size=10, max_size=10))
def test_the_score_of_the_sus_is_brookes_sum(answers):
    expected = 2.5 * sum(a - 1 if item % 2 == 0 else 5 - a for item, a in enumerate(answers))
    scores = SUS.scores({str(item): answer for item, answer in enumerate(answers, 1)})
    assert scores == {"sus": expected}


def test_incomplete_sheets_have_no_score():
    sheets = pd.concat([sheet(BROOKE), sheet(BROOKE[:9], "P2"), sheet([*BROOKE[:9], None], "P3")])
    scores = score_questionnaire(sheets, SUS)
    assert scores["sus"].isna().tolist() == [False, True, True]
    assert scores["answered"].tolist() == [10, 9, 9]


@pytest.mark.parametrize("answer", ["7", "often"])
def test_an_answer_out_of_range_is_refused(answer):
    expected = rf"sus of P1, a: item '1': expected a whole number from 1 to 5, found '{answer}'"
    with pytest.raises(BadInput, match=expected):
        score_questionnaire(sheet([answer, *BROOKE[1:]]), SUS)


def test_an_unknown_or_repeated_item_is_refused():
    with pytest.raises(BadInput, match=r"sus of P1, a: .*unknown item '11'"):
        score_questionnaire(sheet([3] * 11), SUS)
    with pytest.raises(BadInput, match="sus of P1, a: an item was answered twice"):
        score_questionnaire(sheet([3, 3], items=["1", "sus_1"]), SUS)


@pytest.mark.parametrize("prefix", ["sus_", "q", "SUS "])
def test_items_may_have_a_prefix(prefix):
    items = [f"{prefix}{item}" for item in range(1, 11)]
    assert score_questionnaire(sheet(BROOKE, items=items), SUS)["sus"].tolist() == [55.0]


def test_the_raw_tlx_is_the_mean_of_its_six_scales_in_steps_of_five():
    answers = dict(zip([item.key for item in TLX.items], [20, 0, 10, 1, 15, 2], strict=True))
    scores = TLX.scores(answers)
    assert scores["nasa_tlx"] == pytest.approx((100 + 0 + 50 + 5 + 75 + 10) / 6)
    assert (scores["nasa_tlx_mental_demand"], scores["nasa_tlx_performance"]) == (100, 5)
    assert {(scale.low, scale.high) for scale in TLX.scales} == {(0, 100)} and len(TLX.scales) == 7


@pytest.fixture(scope="module")
def with_tlx(tmp_path_factory):
    """A study of four with SUS and NASA-TLX after each condition, and one sheet of the TLX incomplete."""
    made = simulated_study(4, trials=1)
    rows = [
        {**row, "questionnaire": "nasa_tlx", "item": item.key, "answer": (number + at) % 21}
        for number, row in enumerate(
            made["answers"].drop_duplicates(["participant", "condition"]).to_dict("records")
        )
        for at, item in enumerate(TLX.items)
    ][1:]
    answers = pd.concat([made["answers"], pd.DataFrame(rows)])
    return write_study(tmp_path_factory.mktemp("study"), {**made, "answers": answers})


@pytest.fixture(scope="module")
def results(with_tlx):
    return analyse(read_tables(with_tlx), AnalysisPlan())


def test_a_further_questionnaire_is_scored_tested_tabulated_and_described(with_tlx, results):
    tables = read_tables(with_tlx)
    (family,) = (each for each in results.families if each.name == "questionnaires")
    assert family.explored == 7 and len(results.scores["nasa_tlx"]) == 8
    rows = [row for table in result_tables(results) for row in table.rows]
    assert any(row[0] == "NASA-TLX (raw) (0-100)" and row[3] == "3" for row in rows)
    details = detail_tables(results)
    summary = details["questionnaires_summary"].set_index(["measure", "condition"])
    assert summary.loc[("nasa_tlx", "visual"), "n"] + summary.loc[("nasa_tlx", "visual_haptic"), "n"] == 7
    assert set(details["questionnaires"]["questionnaire"]) == {"sus", "nasa_tlx"}
    text = "\n".join(methods(tables, results, read_traces(results.runs, with_tlx), simulated=False))
    assert "NASA-TLX (raw) is the mean of 6 items, from 0 to 100; subscales: TLX Mental Demand" in text
    assert "S. G. Hart" in text and "no score (1 of 8)" in text and "SUS was scored after Brooke" in text


def test_the_scores_of_further_questionnaires_are_drawn_by_condition(results, check_print):
    with styled():
        figure = questionnaire_figure(results, "")
        check_print(figure, "")
    assert len(figure.axes) == 1
    labels = [label.get_text().replace("\n", " ") for label in figure.axes[0].get_xticklabels()]
    assert labels[:2] == ["NASA-TLX (raw)", "TLX Mental Demand"] and len(labels) == 7
    points = [len(line.get_xdata()) for line in figure.axes[0].lines if line.get_marker() in ("o", "s")]
    assert points == [len(results.values[name][condition].dropna()) for condition in results.conditions
                      for name in results.values if name.startswith("nasa")]  # fmt: skip


def test_the_sus_alone_has_no_figure_of_further_questionnaires(tmp_path):
    folder = write_study(tmp_path, simulated_study(3, trials=1))
    assert questionnaire_figure(analyse(read_tables(folder), AnalysisPlan()), "") is None


def unscored(text: str) -> str:
    """Return the text of a questionnaire without its [score] table, as earlier versions shipped it."""
    before, _, after = text.partition("[score]")
    return before + after[after.index("[[item]]") :]


def test_a_sus_that_was_frozen_without_a_score_is_scored():
    old = parse_questionnaire(unscored(SUS.text), "questionnaire sus")
    assert old.score is None
    (found,) = scored_questionnaires(sheet(BROOKE), {"sus": old})
    assert score_questionnaire(sheet(BROOKE), found)["sus"].tolist() == [55.0]


def test_a_frozen_questionnaire_with_other_items_is_not_scored_as_the_one_that_ships():
    other = parse_questionnaire(unscored(SUS.text).replace("high = 5", "high = 7"), "questionnaire sus")
    assert scored_questionnaires(sheet(BROOKE), {"sus": other}) == []


def test_the_frozen_scoring_is_used_and_a_questionnaire_without_one_is_named(tmp_path):
    made = simulated_study(3, trials=1)
    trust = made["answers"].query("item == 1").assign(questionnaire="trust", item="q1")
    folder = write_study(tmp_path, {**made, "answers": pd.concat([made["answers"], trust])})
    halved = SUS.text.replace("range = [0, 100]", "range = [0, 50]")
    frozen = {"sus": halved, "trust.toml": TRUST}
    results = analyse(read_tables(freeze(folder, PROTOCOL, frozen)), AnalysisPlan())
    assert results.unscored == ["trust"] and results.scores["sus"]["sus"].max() <= 50
    frozen["trust.toml"] = TRUST + '\n[score]\nmethod = "sum"\n'
    results = analyse(read_tables(freeze(folder, PROTOCOL, frozen)), AnalysisPlan())
    assert results.unscored == [] and results.quantities["trust"].unit == "1-7"
    assert results.scores["trust"]["answered"].tolist() == [1] * 6
