import json

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from study_tables import simulated_study, write_study

from haptigraph.analysis.study.results import AnalysisPlan, analyse
from haptigraph.analysis.study.runs import condition_values, counted_runs, missing_data, participant_means
from haptigraph.analysis.study.tables import read_tables
from haptigraph.errors import BadInput


def test_tables_are_read_as_written(tmp_path):
    made = simulated_study(participants=3, trials=1)
    tables = read_tables(write_study(tmp_path, made))
    assert np.array_equal(tables.trials["completion_s"], made["trials"]["completion_s"], equal_nan=True)
    assert tables.is_simulated and tables.study == "simulated study"
    assert set(tables.sha256) == {"trials.csv", "answers.csv", "participants.csv"}


def test_answers_and_participants_may_be_absent(tmp_path):
    made = simulated_study(participants=2, trials=1)
    tables = read_tables(write_study(tmp_path, {"trials": made["trials"].assign(study="ours")}))
    assert tables.answers.empty and not tables.is_simulated


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        (lambda t: t.drop(columns="outcome"), "trials.csv: lacks the columns outcome"),
        (lambda t: t.iloc[:0], "trials.csv: contains no trial"),
        (
            lambda t: pd.concat([t, t.iloc[:1]]),
            "line 10: duplicate row with the same participant, condition, block, phase",
        ),
        (
            lambda t: t.assign(outcome=["miss"] + ["hit"] * 7),
            "line 2: outcome must be one of hit, timeout, aborted",
        ),
        (lambda t: t.assign(completion_s=[80, "fast"] + [1] * 6), "line 3: completion_s is not a number"),
        (lambda t: t.assign(completion_s=[80, 70, -1] + [1] * 5), "line 4: completion_s is negative"),
        (lambda t: t.assign(path_mm=[float("inf")] * 8), "line 2: path_mm is not a number"),
        (lambda t: t.assign(participant=[None] + ["P1"] * 7), "line 2: participant is empty"),
        (lambda t: t.assign(study=["a"] * 4 + ["b"] * 4), r"contains 2 studies \(a, b\)"),
    ],
)
def test_invalid_tables_are_refused_with_their_line(tmp_path, change, sentence):
    trials = simulated_study(participants=2, trials=1)["trials"]
    with pytest.raises(BadInput, match=sentence):
        read_tables(write_study(tmp_path, {"trials": change(trials)}))


def test_participants_may_have_any_columns(tmp_path):
    made = simulated_study(participants=2, trials=1)
    made["participants"]["hours_played_s"] = ["many", "none"]
    assert read_tables(write_study(tmp_path, made)).participants["hours_played_s"].tolist() == [
        "many",
        "none",
    ]


def test_a_parquet_file_that_cannot_be_read_is_refused(tmp_path):
    (tmp_path / "trials.parquet").write_bytes(b"no parquet")
    with pytest.raises(BadInput, match=r"trials\.parquet"):
        read_tables(tmp_path)


def test_a_folder_without_tables_is_refused(tmp_path):
    with pytest.raises(BadInput, match=r"contains neither trials\.csv"):
        read_tables(tmp_path)
    with pytest.raises(BadInput, match="no such folder"):
        read_tables(tmp_path / "nothing")


def trial(participant="P1", condition="a", number=1, attempt=1, outcome="hit", seconds=10.0, phase="trial"):
    return {
        "participant": participant, "session": 1, "condition": condition, "block": 1, "position": 1, "phase": phase,
        "trial": number, "attempt": attempt, "outcome": outcome, "completion_s": seconds, "mean_theta_deg": 5.0,
    }  # fmt: skip


def test_the_last_attempt_counts_and_only_hits_have_a_time():
    trials = pd.DataFrame([
        trial(attempt=1, outcome="aborted"), trial(attempt=2, seconds=20),
        trial(number=2, outcome="timeout", seconds=60), trial(number=3, outcome="aborted"), trial(phase="training"),
    ])  # fmt: skip
    runs = counted_runs(trials)
    assert runs["trial"].tolist() == [1, 2]
    assert runs["completion_s"].tolist()[0] == 20 and runs["completion_s"].isna().tolist() == [False, True]
    assert runs["mean_theta_deg"].notna().all()
    counted = missing_data(trials, ["a"]).iloc[0].to_dict()
    assert counted == {
        "condition": "a", "participants": 1, "trials": 3, "hit": 1, "timeout": 1, "aborted": 1, "repeated": 1
    }  # fmt: skip


def test_void_and_unfinished_trials_do_not_count():
    trials = pd.DataFrame([trial(), trial(number=2), trial(number=3, outcome=None)]).assign(
        void=[None, "robot stopped", None]
    )
    assert counted_runs(trials)["trial"].tolist() == [1]
    assert missing_data(trials, ["a"])["aborted"].tolist() == [2]


def test_an_attempt_of_a_later_session_replaces_the_first():
    again = {**trial(attempt=2, seconds=30), "session": 2}
    assert counted_runs(pd.DataFrame([trial(outcome="aborted"), again]))["completion_s"].tolist() == [30]


def test_conditions_have_the_protocols_order_and_withdrawn_participants_are_excluded(tmp_path):
    made = simulated_study(participants=4, conditions=("visual_only", "visual_haptic"), trials=1)
    made["participants"]["withdrawn_utc"] = ["2026-01-01T00:00:00Z", None, None, None]
    write_study(tmp_path, made)
    assert analyse(read_tables(tmp_path), AnalysisPlan()).conditions == ["visual_haptic", "visual_only"]
    protocol = '[[condition]]\nname = "visual_only"\n[[condition]]\nname = "visual_haptic"\n'
    (tmp_path / "study.json").write_text(json.dumps({"study": "s", "parts": {"study.toml": protocol}}))
    results = analyse(read_tables(tmp_path), AnalysisPlan())
    assert results.conditions == ["visual_only", "visual_haptic"]
    assert results.participants == 3 and len(results.scores["sus"]) == 6
    (tmp_path / "study.json").write_text("{")
    with pytest.raises(BadInput, match=r"study\.json: cannot be read"):
        read_tables(tmp_path)


def test_paired_values_are_of_the_same_participants():
    runs = pd.DataFrame([
        trial("P1", "a", seconds=1), trial("P1", "b", seconds=2), trial("P2", "b", seconds=9),
        trial("P3", "a", seconds=3), trial("P3", "a", number=2, seconds=5), trial("P3", "b", seconds=6),
    ])  # fmt: skip
    table = participant_means(runs, "completion_s", ["a", "b"])
    assert condition_values(table, "a", "b", paired=True) == ([1.0, 4.0], [2.0, 6.0])
    assert condition_values(table, "a", "b", paired=False) == ([1.0, 4.0], [2.0, 9.0, 6.0])


@settings(max_examples=20)
@given(st.permutations(range(12)))
def test_the_order_of_rows_does_not_matter(order):
    rows = [
        trial(f"P{who}", condition, number, seconds=who + number)
        for who in (1, 2, 3)
        for condition in "ab"
        for number in (1, 2)
    ]
    table = pd.DataFrame(rows)
    shuffled = table.iloc[list(order)]
    pd.testing.assert_frame_equal(counted_runs(table), counted_runs(shuffled))
