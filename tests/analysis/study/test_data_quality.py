"""The report flags and counts trials of poor data quality, and says where it was not recorded."""

import json

import numpy as np
import pytest
from msgspec.structs import replace
from study_tables import simulated_study, write_study

from haptigraph.analysis.study.data_quality import flagged_trials, quality_by_condition, quality_paragraph
from haptigraph.analysis.study.results import AnalysisPlan, analyse
from haptigraph.analysis.study.tables import read_tables

QUALITY = "[quality]\nmin_images_per_s = 20\nmax_gap_s = 0.5\n"


@pytest.fixture
def folder(tmp_path):
    """Four participants; S01's first visual trial is slow and has a gap, S02's was not recorded."""
    tables = simulated_study(4, trials=2)
    trials = tables["trials"].assign(
        images_per_s=30.0, late_images_fraction=0.0, skipped_images=0, unseen_fraction=0.01,
        long_gaps=0, longest_gap_s=0.2,
    )  # fmt: skip
    one = (trials["condition"] == "visual") & (trials["phase"] == "trial") & (trials["trial"] == 1)
    slow, unknown = one & (trials["participant"] == "S01"), one & (trials["participant"] == "S02")
    trials.loc[slow, ["images_per_s", "long_gaps", "longest_gap_s"]] = [9.0, 1, 2.5]
    trials.loc[unknown, ["images_per_s", "longest_gap_s"]] = np.nan
    return write_study(tmp_path / "study", {**tables, "trials": trials})


def freeze(folder, quality):
    (folder / "study.json").write_text(json.dumps({"title": "Ours", "parts": {"study.toml": quality}}))


def test_trials_beyond_a_threshold_are_flagged_counted_and_analysed(folder):
    freeze(folder, QUALITY)
    tables = read_tables(folder)
    results = analyse(tables, AnalysisPlan())
    (flagged,) = flagged_trials(tables, results).drop(columns="block").itertuples(index=False, name=None)
    problem = "9 images/s (at least 20); 2.5 s in a row without a visible tip (at most 0.5)"
    assert flagged == ("S01", "visual", 1, 1, problem, "yes")
    methods = quality_paragraph(tables, results)
    assert "the median of 15 runs is 30 images/s, the lowest 9" in methods
    assert "at least 20 images/s, at most 0.5 s in a row without a visible tip" in methods
    assert "Beyond them: 1 of 16 runs, 1 of them analysed; 1 could not be judged" in methods
    summary = quality_by_condition(tables).set_index("condition")
    visual = summary.loc["visual", ["runs", "recorded", "images_per_s_min", "long_gaps_sum"]]
    assert visual.tolist() == [8, 7, 9, 1]
    assert summary.loc["visual_haptic", "longest_gap_s_max"] == 0.2


def test_a_flagged_trial_that_the_analysis_leaves_out_is_not_counted_as_analysed(folder):
    freeze(folder, QUALITY)
    tables = read_tables(folder)
    results = analyse(tables, AnalysisPlan())
    results = replace(results, runs=results.runs[results.runs["images_per_s"] != 9.0])
    assert flagged_trials(tables, results)["analysed"].tolist() == ["no"]
    assert "Beyond them: 1 of 16 runs, 0 of them analysed; 1 could not" in quality_paragraph(tables, results)


@pytest.mark.parametrize("quality", [None, ""])
def test_without_thresholds_nothing_is_flagged_and_the_report_says_why(folder, quality):
    if quality is not None:
        freeze(folder, quality)
    tables = read_tables(folder)
    results = analyse(tables, AnalysisPlan())
    assert flagged_trials(tables, results).empty and len(quality_by_condition(tables)) == 2
    assert "The protocol sets no thresholds, so no trial is flagged" in quality_paragraph(tables, results)


def test_old_tables_have_no_data_quality_and_the_report_says_so(tmp_path):
    folder = write_study(tmp_path / "old", simulated_study(3, trials=1))
    freeze(folder, QUALITY)
    tables = read_tables(folder)
    results = analyse(tables, AnalysisPlan())
    assert quality_paragraph(tables, results) == "Data quality: not recorded."
    assert quality_by_condition(tables).empty and flagged_trials(tables, results).empty
