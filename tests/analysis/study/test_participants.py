import re
import shutil
from itertools import islice
from pathlib import Path

import pandas as pd
import pytest
from study_tables import simulated_study, write_study

from haptigraph.analysis.study.participants import participant_pages
from haptigraph.analysis.study.results import AnalysisPlan, analyse
from haptigraph.analysis.study.runs import counted_runs
from haptigraph.analysis.study.tables import read_tables
from haptigraph.analysis.study.traces import Trace, Traces, read_traces
from haptigraph.recording.reader import RunReader


@pytest.fixture
def study(study, tmp_path) -> Path:
    """A copy, to be changed."""
    return shutil.copytree(study, tmp_path / "study")


def pages_of(folder) -> dict[str, str]:
    tables = read_tables(folder)
    results = analyse(tables, AnalysisPlan())
    traces = read_traces(results.runs, folder)
    flags = pd.DataFrame(
        [("S02", "visual", 1, "9 images/s")], columns=["participant", "condition", "trial", "problem"]
    )
    return dict(participant_pages(tables, results, traces, flags, "SIMULATED"))


def rows_of(html: str) -> list[list[str]]:
    rows = re.findall(r"<tr>(.*?)</tr>", html)
    return [re.findall(r"<t[hd][^>]*>(.*?)</t[hd]>", row) for row in rows]


def test_a_page_has_the_trials_measures_traces_and_scores_of_one_participant(study):
    trials = pd.read_csv(study / "trials.csv")
    trials.loc[(trials["participant"] == "S02") & (trials["trial"] == 2), "outcome"] = "aborted"
    trials["images_per_s"] = trials["condition"].map({"visual": 30.0, "visual_haptic": 9.0})
    trials.to_csv(study / "trials.csv", index=False)
    pages = pages_of(study)
    assert sorted(pages) == [f"S{number:02}.html" for number in range(1, 9)]
    page = pages["S02.html"]
    assert "S01" not in page and "SIMULATED" in page and "<script" not in page
    assert not re.search(r'(src|href)="(?!data:)', page) and "color-scheme: light dark" in page
    rows = rows_of(page)
    assert [row[:3] for row in rows[1:7]] == [
        ["Training", "-", "Visual"],
        ["Trial", "1", "Visual"],
        ["Trial", "-", "Visual"],
        ["Training", "-", "Visual haptic"],
        ["Trial", "2", "Visual haptic"],
        ["Trial", "-", "Visual haptic"],
    ]
    mine = trials[(trials["participant"] == "S02") & (trials["phase"] == "trial") & (trials["trial"] == 1)]
    theta = mine.sort_values("position")["mean_theta_deg"]
    assert ["Alignment Angle (°)", *(f"{value:.1f}" for value in theta)] in rows
    assert "<p>Flagged: Visual, trial 1: 9 images/s.</p>" in page and "Flagged" not in pages["S03.html"]
    assert ["Images per Second", "30.0", "9.0"] in rows
    assert page.count("data:image/svg+xml") == 1 and "Without a readable recording" not in page
    answers = pd.read_csv(study / "answers.csv").query(
        "participant == 'S02' and condition == 'visual_haptic'"
    )
    odd, answer = answers["item"] % 2 == 1, answers["answer"]
    score = 2.5 * (answer.where(odd, 6 - answer) - 1).sum()
    assert ["SUS Score", "Visual haptic", f"{score:.1f}"] in rows
    assert "Without a readable recording: 4 of 4 runs" in pages["S05.html"]


def test_the_trace_of_a_timeout_goes_on_to_the_end_of_the_recording(study, monkeypatch):
    trials = pd.read_csv(study / "trials.csv")
    mine = trials["recording"].notna() & (trials["participant"] == "S01") & (trials["condition"] == "visual")
    trials.loc[mine, "outcome"] = "timeout"
    trials.to_csv(study / "trials.csv", index=False)
    runs, whole = counted_runs(read_tables(study).trials), RunReader.records
    assert not of_participant(read_traces(runs, study), "S01", "visual")  # the recording has a hit after all
    monkeypatch.setattr(RunReader, "records", lambda *args, **options: islice(whole(*args, **options), 60))
    traces = read_traces(runs, study)
    (timeout,) = of_participant(traces, "S01", "visual")
    assert not timeout.is_hit and not traces.of("visual") and 8 < timeout.duration_s < 12
    assert not of_participant(traces, "S02", "visual")  # without the hit that the table has


def of_participant(traces: Traces, name: str, condition: str) -> list[Trace]:
    return [trace for trace in traces.runs if (trace.participant, trace.condition) == (name, condition)]


def test_a_participant_of_any_name_gets_a_file_in_the_folder(tmp_path):
    tables = simulated_study(2, trials=1)
    for table in tables.values():
        table["participant"] = table["participant"].replace("S02", "../<b>S02")
    pages = pages_of(write_study(tmp_path, tables))
    assert "<h1>../&lt;b&gt;S02" in pages["..%2F%3Cb%3ES02.html"]
