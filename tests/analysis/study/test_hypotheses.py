import math

import pandas as pd
import pytest
from helpers import call, refuse
from hypothesis import given, settings
from hypothesis import strategies as st
from study_tables import ANALYSIS, PROTOCOL, freeze, simulated_study, write_study

from haptigraph.analysis.study.detail_tables import detail_tables
from haptigraph.analysis.study.preregistered.hypotheses import decide, holm_corrected
from haptigraph.analysis.study.quantities import QUANTITIES
from haptigraph.analysis.study.results import AnalysisPlan, analyse
from haptigraph.analysis.study.results_table import hypothesis_table, result_tables
from haptigraph.analysis.study.statistics.comparison import compare
from haptigraph.analysis.study.tables import read_tables
from haptigraph.analysis.study.writing.estimates import equivalence
from haptigraph.analysis.study.writing.methods import preregistered
from haptigraph.errors import BadInput
from haptigraph.study.frozen.analysis_plan import Analysis, Hypothesis, numeric_measures

TIME, THETA = QUANTITIES[:2]
LOW, HIGH = [1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0], [3.0, 4.5, 6.0, 7.5, 9.0, 10.5, 12.0]


@pytest.fixture(scope="module")
def frozen(tmp_path_factory):
    """A study of 8 whose protocol has an [analysis] table."""
    folder = write_study(tmp_path_factory.mktemp("study"), simulated_study(8))
    return freeze(folder, PROTOCOL + ANALYSIS)


@pytest.fixture(scope="module")
def results(frozen):
    return analyse(read_tables(frozen), AnalysisPlan())


def theta_of(first, second):
    found = compare(THETA, ("a", "b"), (first, second), paired=True, seed=1)
    assert found is not None
    return found


def decision(expect, first, second, comparison):
    hypothesis = Hypothesis("mean_theta_deg", first, second, expect)
    (found,) = decide(Analysis(("mean_theta_deg",), (hypothesis,)), [comparison])
    return found


@pytest.mark.parametrize(
    ("expect", "supported"), [("greater", True), ("smaller", False), ("different", True)]
)
def test_a_hypothesis_is_supported_only_in_its_direction(expect, supported):
    assert decision(expect, "a", "b", theta_of(LOW, HIGH)).is_supported is supported


def test_the_direction_follows_the_hypothesis_and_not_the_order_of_the_comparison():
    assert decision("smaller", "b", "a", theta_of(LOW, HIGH)).is_supported is True
    assert decision("greater", "b", "a", theta_of(LOW, HIGH)).is_supported is False


def test_a_preregistered_equivalence_is_tested_within_its_bounds(results):
    (alike,) = [table for table in result_tables(results) if table.label == "equivalence"]
    assert alike.rows[0][2] == "-10 to 10" and alike.rows[0][-1] == "yes"
    assert "Completion Time -10 to 10 s" in equivalence(results)
    assert detail_tables(results)["equivalence"]["equivalent"].tolist() == [True]


def test_an_effect_that_is_not_significant_supports_nothing():
    found = decision("different", "a", "b", theta_of(LOW, [1.1, 1.9, 3.1, 3.9, 5.1, 5.9, 7.1]))
    assert found.is_supported is False and found.p > 0.05


def test_each_family_is_corrected_alone_and_an_untested_hypothesis_counts_as_one():
    comparisons = [theta_of(LOW, HIGH), compare(TIME, ("a", "b"), (LOW, HIGH), paired=True, seed=1)]
    primary = [Hypothesis("mean_theta_deg", "a", "b"), Hypothesis("sus", "a", "b")]
    analysis = Analysis(("mean_theta_deg", "sus"), (*primary, Hypothesis("completion_s", "a", "b")))
    theta, sus, time = decide(analysis, comparisons)
    assert theta.holm_p == pytest.approx(2 * theta.p) and time.holm_p == pytest.approx(time.p)
    assert math.isnan(sus.p) and math.isnan(sus.holm_p) and sus.is_supported is None and sus.why_untested


@settings(max_examples=10)  # each collects garbage twice, in statsmodels
@given(st.lists(st.one_of(st.floats(0, 1), st.just(math.nan)), max_size=6))
def test_a_test_that_is_missing_never_helps_the_others(p):
    corrected = holm_corrected(p, 0.05)
    alone = iter(holm_corrected([each for each in p if not math.isnan(each)], 0.05))
    for before, after in zip(p, corrected, strict=True):
        assert math.isnan(after) if math.isnan(before) else after >= next(alone) >= before - 1e-12


def test_the_report_says_what_is_confirmatory_and_what_is_exploratory(frozen, tmp_path, monkeypatch):
    monkeypatch.setattr("haptigraph.analysis.study.report.draw_figures", lambda *_: [])  # which take seconds
    output = call("study", "report", frozen, "-o", tmp_path / "out").output
    assert "| Alignment Angle with “Eyes & hands” is smaller than that with “Eyes” | primary |" in output
    tests = pd.read_csv(tmp_path / "out" / "csv" / "comparisons.csv").set_index("measure")["status"]
    assert set(tests.index[tests == "confirmatory"]) == {"mean_theta_deg", "sus"}
    decided = pd.read_csv(tmp_path / "out" / "csv" / "hypotheses.csv").set_index("measure")
    assert list(decided.loc["completion_s", ["low", "high"]]) == [-10, 10]
    text = (tmp_path / "out" / "methods.txt").read_text()
    assert "preregistered 1 primary (Alignment Angle) and 2 other hypotheses" in text
    assert "level of significance is 0.04" in text
    html = (tmp_path / "out" / "report.html").read_text()
    assert "with preregistered hypotheses" in html and "<td>confirmatory</td>" in html


def test_without_an_analysis_everything_is_exploratory(tmp_path):
    folder = freeze(write_study(tmp_path / "study", simulated_study(3, trials=1)))
    results = analyse(read_tables(folder), AnalysisPlan())
    assert results.hypotheses == [] and results.plan.alpha == 0.05 and results.plan.bounds_of(TIME) is None
    assert preregistered(results).startswith("Exploratory: no analysis was preregistered")
    assert hypothesis_table(results) == [] and "Test" not in result_tables(results)[0].head


def test_a_confirmatory_p_is_corrected_among_the_hypotheses_and_the_rest_among_themselves(results):
    theta, sus, time = results.hypotheses
    assert (theta.holm_p, sus.holm_p, time.holm_p) == (theta.p, sus.p, pytest.approx(2 * time.p))
    assert time.is_supported and time.test.startswith("TOST")
    primary = next(family for family in results.families if family.name == "primary")
    corrected = {each.quantity.name: p for each, p in zip(primary.comparisons, primary.holm, strict=True)}
    explored = next(each for each in primary.comparisons if each.quantity.name == "completion_s")
    assert corrected == {
        "completion_s": pytest.approx(explored.test.p),
        "mean_theta_deg": theta.holm_p,
        "sus": sus.holm_p,
    }
    assert primary.explored == 1 and time.is_supported


def test_the_bounds_of_equivalence_reach_the_results(results):
    assert results.plan.bounds_of(TIME) == (-10, 10) and results.plan.bounds_of(THETA) is None
    assert [each.bounds for each in results.hypotheses] == [None, None, (-10, 10)]


def test_an_alpha_that_contradicts_the_preregistered_one_is_refused(frozen, results, tmp_path):
    sentence = refuse("study", "report", frozen, "-o", tmp_path / "out", "--alpha", "0.1")
    assert "alpha 0.1 contradicts the preregistered 0.04; leave it out" in sentence
    assert not (tmp_path / "out").exists() and results.plan.alpha == 0.04
    assert analyse(read_tables(frozen), AnalysisPlan(given_alpha=0.04)).plan.alpha == 0.04


def test_a_baseline_that_would_turn_the_equivalence_bounds_is_refused(frozen):
    tables = read_tables(frozen)
    with pytest.raises(BadInput, match="baseline 'visual_haptic' would turn the signs"):
        analyse(tables, AnalysisPlan(baseline="visual_haptic"))


def test_participants_with_too_few_trials_are_excluded_and_counted(tmp_path):
    made = simulated_study(5, trials=2)
    trials = made["trials"]
    lost = trials["participant"].isin(["S02"]) & (trials["trial"] == 2) & (trials["condition"] == "visual")
    trials.loc[lost | (trials["participant"] == "S04"), "outcome"] = "aborted"
    folder = freeze(write_study(tmp_path, made), PROTOCOL + ANALYSIS)
    results = analyse(read_tables(folder), AnalysisPlan())
    assert results.excluded == ["S02", "S04"] and results.participants == 3
    assert sorted(set(results.runs["participant"])) == ["S01", "S03", "S05"]
    assert set(results.scores["sus"]["participant"]) == {"S01", "S03", "S05"}
    everyone = freeze(folder, PROTOCOL + ANALYSIS.replace("min_trials = 2", "min_trials = 3"))
    with pytest.raises(BadInput, match=r"found none \(5 participants have too few trials\)"):
        analyse(read_tables(everyone), AnalysisPlan())
    exclusion_off = freeze(folder, PROTOCOL + ANALYSIS.replace("min_trials = 2", ""))
    assert analyse(read_tables(exclusion_off), AnalysisPlan()).excluded == []


def test_trials_beyond_a_threshold_are_excluded_and_counted(tmp_path):
    made = simulated_study(4, trials=2)
    made["trials"]["images_per_s"] = [9.1 if row == 1 else 30.0 for row in range(len(made["trials"]))]
    folder = write_study(tmp_path, made)
    quality = "\n[quality]\nmin_images_per_s = 20\n"
    rules = ANALYSIS.replace("min_trials = 2", "min_trials = 1\nexclude_poor_trials = true")
    results = analyse(read_tables(freeze(folder, PROTOCOL + rules + quality)), AnalysisPlan())
    assert (results.poor_trials, len(results.runs), results.excluded) == (1, 15, [])
    text = preregistered(results)
    assert "trials beyond a threshold of data quality (1), participants with no valid trial" in text
    kept = analyse(read_tables(freeze(folder, PROTOCOL + ANALYSIS + quality)), AnalysisPlan())
    assert (kept.poor_trials, len(kept.runs)) == (0, 16)


def test_every_measure_that_a_protocol_may_name_is_analysed():
    outcomes = {each.name for each in QUANTITIES}
    assert set(numeric_measures((), ())) == outcomes - {"sus"}


def test_a_hypothesis_about_a_questionnaire_that_nobody_answered_is_not_tested(tmp_path):
    analysis = ANALYSIS.replace('measure = "sus"', 'measure = "nasa_tlx"')
    folder = freeze(write_study(tmp_path, simulated_study(4, trials=2)), PROTOCOL + analysis)
    results = analyse(read_tables(folder), AnalysisPlan())
    assert results.hypotheses[1].is_supported is None and results.absent["Nasa tlx"] == "not recorded"
    assert (
        "Nasa tlx with “Eyes & hands” differs from that with “Eyes” (no values to compare)"
        in preregistered(results)
    )


def test_a_further_measure_may_be_primary(tmp_path):
    analysis = ANALYSIS.replace("mean_theta_deg", "path_mm")
    folder = freeze(write_study(tmp_path, simulated_study(4, trials=2)), PROTOCOL + analysis)
    results = analyse(read_tables(folder), AnalysisPlan())
    assert "path_mm" in {each.quantity.name for each in results.families[0].comparisons}
    assert "path_mm" in {model.name for model in results.order} | {
        name for name, each in results.quantities.items() if each.label in results.unmodelled
    }


def test_a_frozen_analysis_that_cannot_be_read_is_refused(tmp_path):
    folder = write_study(tmp_path, simulated_study(3, trials=1))
    with pytest.raises(BadInput, match=r"study\.json: cannot be read"):
        read_tables(freeze(folder, PROTOCOL + "\n[analysis]\nprimary = 3\n"))
