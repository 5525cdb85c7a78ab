from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pandas as pd
import pytest
from helpers import mostly_slow
from matplotlib.figure import Figure
from scipy import stats
from study_tables import simulated_study, write_study

from haptigraph.analysis.study.figures.drawn import Drawn, figures, figures_tex
from haptigraph.analysis.study.figures.learning import session_places
from haptigraph.analysis.study.figures.motion import alignment_figure, cone_figure
from haptigraph.analysis.study.figures.person import person_figure
from haptigraph.analysis.study.figures.raincloud import JOINED, density
from haptigraph.analysis.study.figures.style import ONE_COLUMN_MM, TWO_COLUMNS_MM, styled
from haptigraph.analysis.study.results import AnalysisPlan, StudyResults, analyse
from haptigraph.analysis.study.runs import counted_runs
from haptigraph.analysis.study.tables import read_tables
from haptigraph.analysis.study.traces import read_traces

NOTE = "SIMULATED"


LONG = ("no_touch", "continuous_guidance_of_the_needle", "visual_haptic")
CASES = {
    "three long names": dict(participants=9, conditions=LONG, trials=4),
    "one trial each": dict(participants=5, trials=1),
    "two groups": dict(participants=16, within=False, trials=4),
}


@cache
def analysed(case) -> StudyResults:
    with TemporaryDirectory() as folder:
        return analyse(read_tables(write_study(Path(folder), simulated_study(**CASES[case]))), AnalysisPlan())


@cache
def drawn(case) -> dict[str, Figure]:
    results = analysed(case)
    with styled():
        return figures(results, read_traces(results.runs, Path("no recordings")), NOTE)


@pytest.mark.parametrize("case", mostly_slow(CASES, "three long names"))
def test_every_figure_can_be_printed_at_the_width_of_a_column(case, check_print):
    assert set(drawn(case)) == {"rainclouds", "state_times", "state_sequence", "learning"}
    with styled():
        for figure in drawn(case).values():
            check_print(figure, NOTE)


def test_figures_of_recordings_can_be_printed_at_the_width_of_a_column(study, check_print):
    traces = read_traces(counted_runs(read_tables(study).trials), study)
    titles = {"visual": "Visual feedback only", "visual_haptic": "Visual and haptic feedback"}
    with styled():
        check_print(alignment_figure(traces, titles, NOTE), NOTE)
        check_print(cone_figure(traces, titles, NOTE), NOTE)
        shown = [trace for trace in traces.runs if trace.participant == "S01"] * 3
        names = {trace.run: "1 Visual, hit" for trace in shown}
        check_print(person_figure(traces, shown, names, NOTE), NOTE)


def test_a_line_joins_the_values_of_each_participant_and_none_two_groups():
    within, between = (
        [
            line.get_ydata()
            for line in drawn(case)["rainclouds"].axes[0].get_lines()
            if line.get_color() == JOINED
        ]
        for case in ("one trial each", "two groups")
    )
    np.testing.assert_array_equal(within, analysed("one trial each").values["completion_s"].to_numpy(float))
    assert not between


def test_a_density_stays_within_the_values_and_needs_eight_of_them():
    values = stats.norm.ppf(np.linspace(0.05, 0.95, 8))
    at, height = density(values)
    assert at[0] == values.min() and at[-1] == values.max()
    assert (
        0.7 < np.trapezoid(height, at) < 1
    )  # the tails of the kernel beyond the values are cut off, not moved
    assert at[height.argmax()] == pytest.approx(0, abs=0.05)
    assert density(values[:7]) is None and density(np.ones(20)) is None


def test_trials_are_placed_in_the_session_by_the_position_of_their_condition():
    rows = [("A", 2, 1, 1), ("A", 2, 2, 1), ("A", 1, 1, 1), ("A", 1, 1, 2), ("B", 1, 1, 1)]
    runs = pd.DataFrame(rows, columns=["participant", "position", "block", "trial"])
    placed = session_places(runs)
    steps = list(zip(placed["position"], placed["number"], placed["place"], strict=True))
    assert steps == [(1, 1, 0), (1, 2, 1), (2, 1, 2.6), (2, 2, 3.6), (1, 1, 0)]


def test_medians_of_the_learning_curve_are_those_of_three_or_more_runs():
    runs, axes = analysed("three long names").runs, drawn("three long names")["learning"].axes[0]
    runs = runs[runs["condition"] == LONG[1]].dropna(subset=["completion_s"])
    groups = runs.groupby(["position", "block", "trial"])["completion_s"]
    expected = groups.median()[groups.size() >= 3].to_numpy()
    medians = [
        line.get_ydata()
        for line in axes.get_lines()
        if line.get_linewidth() == 1.4 and line.get_marker() == "o"
    ]
    np.testing.assert_allclose(np.concatenate(medians), expected)


def test_latex_includes_every_figure_at_its_size_with_its_caption():
    wide, narrow = (
        Drawn(name, "Of 95 %.", mm, {}) for name, mm in (("one", TWO_COLUMNS_MM), ("two", ONE_COLUMN_MM))
    )
    tex = figures_tex([wide, narrow], NOTE)
    assert tex.count(r"\caption{SIMULATED: Of 95 \%.}") == 2
    assert r"\begin{figure*}[t]" in tex and r"\includegraphics[width=177mm]{figures/one.pdf}" in tex
    assert r"\begin{figure}[t]" in tex and r"\includegraphics[width=85mm]{figures/two.pdf}" in tex
