import json
import re
import shutil
from pathlib import Path

import pandas as pd
import pytest
from helpers import call, refuse
from study_tables import simulated_study, write_study

from haptigraph.analysis.study.detail_tables import detail_tables
from haptigraph.analysis.study.figures import drawn
from haptigraph.analysis.study.figures.motion import alignment_figure
from haptigraph.analysis.study.figures.states import transitions
from haptigraph.analysis.study.figures.style import rendered
from haptigraph.analysis.study.report import write_report
from haptigraph.analysis.study.results import AnalysisPlan, StudyResults, analyse
from haptigraph.analysis.study.results_table import latex, result_tables
from haptigraph.analysis.study.runs import counted_runs
from haptigraph.analysis.study.tables import read_tables
from haptigraph.analysis.study.traces import GRID, read_traces
from haptigraph.analysis.study.writing.estimates import runs_without_hit
from haptigraph.errors import BadInput

PAPERS = ("visual_only", "visual_haptic")


@pytest.fixture(scope="module")
def results(study) -> StudyResults:
    return analyse(read_tables(study), AnalysisPlan())


def contents(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*.*")}


@pytest.mark.slow  # `make test` reproduces a report by the script of its bundle
def test_the_report_is_reproducible(study, tmp_path):
    call("study", "report", study, "-o", tmp_path / "one", "--seed", "4")
    written = write_report(study, tmp_path / "two", AnalysisPlan(seed=4))
    one = contents(tmp_path / "one")
    assert one == contents(tmp_path / "two") and len(one) == len(written.files)


def test_the_report_is_complete_and_self_contained(study, tmp_path, monkeypatch):
    monkeypatch.setattr(drawn, "rendered", lambda figure: rendered(figure, ("svg",)))  # all: of a bundle
    output = call("study", "report", study, "-o", tmp_path / "one", "--seed", "4").output
    names = set(contents(tmp_path / "one"))
    for figure in ("rainclouds", "state_times", "state_sequence", "alignment", "depth_theta", "learning"):
        assert f"figures/{figure}.svg" in names
    html = (tmp_path / "one" / "report.html").read_text()
    assert not re.search(r'(src|href)="(?!data:)', html) and "<script" not in html
    assert html.count("data:image/svg+xml") == 6 and "SIMULATED: no people took part" in html
    assert "exploratory: no analysis was preregistered" in html
    assert "| Completion Time (s) |" in output and "SIMULATED" in output
    assert "every test is exploratory" in output
    methods = (tmp_path / "one" / "methods.txt").read_text()
    for sentence in (
        "Wilcoxon signed-rank, two-sided, exact",
        "seed 4",
        "scipy 1",
        "Holm",
        "inverts the exact test",
        "median of the Walsh averages",
        "No bounds of equivalence were preregistered, so equivalence was not tested",
        "McNemar, exact binomial",
        "runs without a hit were ranked last (Lachin 1999)",
        "No data were imputed",
        "SHA-256",
    ):
        assert sentence in methods
    svg = (tmp_path / "one" / "figures" / "depth_theta.svg").read_text()
    assert "<dc:date>" not in svg
    check_csv(tmp_path / "one" / "csv")
    assert "9 images/s (at least 20)" in html and "Data quality by condition" in html
    assert "Beyond them: 1 of 32 runs, 1 of them analysed." in methods
    assert {"csv/flagged_trials.csv", "csv/data_quality.csv"} <= names


def check_csv(folder):
    tests = pd.read_csv(folder / "comparisons.csv").set_index("measure")
    variants = pd.read_csv(folder / "rank_test_variants.csv")
    assert (tests["p_holm"] >= tests["p"]).all() and tests["test"].str.contains("Wilcoxon").all()
    assert not {"t_low", "t_high"} & set(tests)  # covers too little
    assert (tests["shift_low"].dropna() <= tests["shift"][tests["shift_low"].notna()]).all()
    hits, worst = (pd.read_csv(folder / f"{name}.csv").iloc[0] for name in ("hit_rate", "worst_rank"))
    assert hits["n_first"] == hits["n_second"] == worst["pairs"] == 8
    assert hits["hits_first"] < 8 or hits["hits_second"] < 8
    reported = variants[variants["reported"]].set_index("measure")["p"]
    assert reported[tests.index].to_numpy() == pytest.approx(tests["p"].to_numpy())
    values = pd.read_csv(folder / "participants_by_condition.csv")
    angle = values[(values["measure"] == "mean_theta_deg") & (values["condition"] == "visual")]["value"]
    assert len(angle) == 8 and angle.mean() == pytest.approx(tests.loc["mean_theta_deg", "mean_first"])


def test_the_papers_table_is_set_in_latex(results):
    tex = latex(result_tables(results)[:1], "SIMULATED")
    assert tex.count(r"\\") == 4 and r"\toprule" in tex and r"Alignment Angle ($^\circ$)" in tex
    assert r"\textbf{Visual haptic}" in tex and "SIMULATED: " in tex and "±" not in tex


def test_hit_rates_have_a_table_and_equivalence_needs_bounds(results):
    plain = result_tables(results)
    assert not any("Equivalence" in table.caption for table in plain)
    assert plain[0].head[-2:] == ["Difference [95 % CI]", "r [95 % CI]"]
    assert (
        plain[-1].rows[0][1:3] == ["8/8", "7/8"] and "hit the target in all their runs" in plain[-1].caption
    )


def test_without_timeouts_nothing_is_said_about_hit_rates(tmp_path):
    made = simulated_study(6, trials=1)
    made["trials"] = made["trials"].assign(outcome="hit", completion_s=60.0 + made["trials"].index)
    results = analyse(read_tables(write_study(tmp_path / "study", made)), AnalysisPlan())
    assert results.timeouts == [] and "hit_rate" not in detail_tables(results)
    assert runs_without_hit(results).startswith("Every counted run ended with a hit")


def holm(p: list[float]) -> list[float]:
    """Correct p-values by the method of Holm (1979)."""
    order, largest, adjusted = sorted(range(len(p)), key=p.__getitem__), 0.0, [0.0] * len(p)
    for step, index in enumerate(order):
        largest = adjusted[index] = max(largest, min(1.0, (len(p) - step) * p[index]))
    return adjusted


def test_p_is_corrected_by_holms_method_within_each_family(results):
    # R: p.adjust(c(0.01, 0.02, 0.03, 0.04, 0.05), "holm")
    assert holm([0.01, 0.02, 0.03, 0.04, 0.05]) == pytest.approx([0.05, 0.08, 0.09, 0.09, 0.09])
    families = results.families
    assert [family.name for family in families] == ["primary", "states", "secondary"]
    for family in families:
        assert family.holm == pytest.approx(holm([each.test.p for each in family.comparisons]), abs=1e-12)


def test_three_conditions_and_two_groups_are_analysed(tmp_path):
    three = simulated_study(6, conditions=("none", "continuous_haptic", "visual_haptic"), trials=1)
    results = analyse(read_tables(write_study(tmp_path / "three", three)), AnalysisPlan(baseline="none"))
    assert results.conditions == ["none", "continuous_haptic", "visual_haptic"]
    assert len(results.families[0].comparisons) == 9 and len(results.families[0].omnibus) == 3
    groups = simulated_study(10, within=False, trials=1)
    results = analyse(read_tables(write_study(tmp_path / "groups", groups)), AnalysisPlan())
    assert not results.is_within and not results.order
    assert all("Mann-Whitney" in each.test.variant for each in results.families[0].comparisons)


def test_traces_span_from_entry_to_hit(study):
    tables = read_tables(study)
    traces = read_traces(counted_runs(tables.trials), study)
    assert len(traces.hits) == 4 and traces.absent == len(counted_runs(tables.trials)) - 4
    assert traces.zones.aligned_deg == 1.7 and traces.zones.touching_mm == 0.7 and traces.is_simulated
    for run in traces.hits:
        assert run.duration_s > 1 and run.states[-1][1] == "target_hit"
        assert run.theta_deg.shape == GRID.shape
        assert run.distance_mm[-1] <= 0.7 < run.distance_mm[0]  # it ends in a hit
    aligned = traces.by_participant("visual_haptic", "theta_deg")[0]
    assert aligned[len(GRID) // 2] < 1.7 < aligned[0]


def test_a_recording_with_another_hash_is_refused_and_nothing_is_written(study, tmp_path):
    study = shutil.copytree(study, tmp_path / "study")
    trials = pd.read_csv(study / "trials.csv", dtype=str)
    trials["recording_sha256"] = trials["recording_sha256"].str.replace(r"^.", "x", regex=True)
    trials.to_csv(study / "trials.csv", index=False)
    with pytest.raises(BadInput, match="is not the recording of this trial"):
        write_report(study, tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_without_recordings_the_figures_that_need_them_are_omitted(tmp_path):
    folder = write_study(tmp_path / "study", simulated_study(4, trials=1))
    results = analyse(read_tables(folder), AnalysisPlan())
    assert alignment_figure(read_traces(results.runs, folder), results.titles, "") is None


def test_people_read_the_titles_of_the_conditions_and_programs_their_names(tmp_path, monkeypatch):
    monkeypatch.setattr(drawn, "rendered", lambda figure: rendered(figure, ("svg",)))  # others take seconds
    study = write_study(tmp_path / "study", simulated_study(3, trials=1))
    protocol = (
        '[[condition]]\nname = "visual"\ntitle = "Eyes <only>"\n[[condition]]\nname = "visual_haptic"\n'
    )
    export = {"study": "s", "parts": {"study.toml": protocol + 'title = "Eyes & hands"\n'}}
    (study / "study.json").write_text(json.dumps(export))
    html = write_report(study, tmp_path / "out").page.read_text()
    assert "Visual haptic" not in html and "visual_haptic" not in re.sub(r"tab:\w+", "", html)
    assert "<td>Eyes &amp; hands</td>" in html
    for name in ("results.tex", "results.md", "methods.txt"):
        assert "Visual haptic" not in (tmp_path / "out" / name).read_text()
    assert "“Eyes <only>”, “Eyes & hands”" in (tmp_path / "out" / "methods.txt").read_text()
    for figure in (tmp_path / "out" / "figures").glob("*.svg"):
        assert "<!-- Visual" not in figure.read_text() and "Eyes" in figure.read_text()
    tests = pd.read_csv(tmp_path / "out" / "csv" / "comparisons.csv")
    assert set(tests["first"]) == {"visual"} and set(tests["second"]) == {"visual_haptic"}


def test_conditions_with_the_same_title_are_named(tmp_path):
    folder = write_study(tmp_path, simulated_study(3, trials=1))
    same = "".join(f'[[condition]]\nname = "{name}"\ntitle = "C"\n' for name in ("visual", "visual_haptic"))
    (folder / "study.json").write_text(json.dumps({"study": "s", "parts": {"study.toml": same}}))
    assert list(analyse(read_tables(folder), AnalysisPlan()).titles.values()) == ["Visual", "Visual haptic"]


def test_transitions_are_counted_per_run(results):
    table = transitions(results)
    entries = table[table["before"] == "start"]
    assert (entries["per_run"] == 1).all() and (entries["runs"] == entries["count"]).all()
    hits = table[table["after"] == "target_hit"].groupby("condition")["per_run"].sum()
    assert hits.to_dict() == {"visual": 1, "visual_haptic": 1}


def test_one_condition_is_refused(tmp_path):
    folder = write_study(tmp_path / "study", simulated_study(3, conditions=("visual",), trials=1))
    sentence = refuse("study", "report", folder, "-o", tmp_path / "out")
    assert "needs two conditions" in sentence and "only 'visual'" in sentence
    assert not (tmp_path / "out").exists()


def test_an_unknown_baseline_is_refused(study, tmp_path):
    sentence = refuse("study", "report", study, "-o", tmp_path / "out", "--baseline", "visul")
    assert "did you mean 'visual'?" in sentence


@pytest.fixture(scope="module")
def renewed(tmp_path_factory) -> Path:
    """A report on the paper's conditions, over an earlier one of two who have withdrawn since."""
    made, when = simulated_study(5, trials=1, conditions=PAPERS), "2026-11-21T09:00:00+00:00"
    people = made["participants"].assign(enrolled_utc=when, withdrawn_utc=None)
    people.loc[people["participant"] == "S03", "withdrawn_utc"] = "2026-11-21T10:00:00+00:00"
    people.loc[people["participant"] == "S05", "withdrawn_utc"] = when  # with no other data
    others = {name: made[name][made[name]["participant"] != "S05"] for name in ("trials", "answers")}
    folder = tmp_path_factory.mktemp("renewed")
    (folder / "out" / "participants").mkdir(parents=True)
    for name in ("S03.html", "S05.html", "notes.txt"):
        (folder / "out" / "participants" / name).write_text("of an earlier report")
    study = write_study(folder / "study", {**others, "participants": people})
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("haptigraph.analysis.study.report.draw_figures", lambda *_: [])  # which take seconds
        write_report(study, folder / "out", AnalysisPlan())
    return folder / "out"


def test_the_methods_count_withdrawn_and_erased_participants(renewed):
    methods = (renewed / "methods.txt").read_text()
    assert "withdrew and are excluded: 2, 1 of them with all their data erased." in methods


def test_who_withdrew_has_no_page_and_loses_an_earlier_one(renewed):
    left = sorted(path.name for path in (renewed / "participants").iterdir())
    assert left == ["S01.html", "S02.html", "S04.html", "notes.txt"]


def test_a_rehearsal_of_the_papers_study_is_set_beside_the_paper_and_said_to_be_no_evidence(renewed):
    for name in ("report.html", "results.md"):
        text = (renewed / name).read_text()
        assert "Simulated participants are no evidence about people" in text
        assert "87.3 ± 20.4" in text and "“Surgical State Time Distribution”: state_times" in text
    assert r"\label{tab:beside_paper}" in (renewed / "results.tex").read_text()
