"""Sweeps: variations, stored results, and recovery from killed workers."""

import os
import pickle
import signal
from contextlib import closing
from multiprocessing import active_children

import pandas as pd
import pytest
from distributed import LocalCluster
from msgspec.structs import replace

from haptigraph.analysis.study_sweep.results import SweepResults
from haptigraph.analysis.study_sweep.study_sweep import AS_DRAWN, Sweep, run_sweep, run_task, variations_of
from haptigraph.analysis.study_sweep.summary import markdown, sweep_summary, trials_table
from haptigraph.errors import BadInput
from haptigraph.spreading import spread
from haptigraph.spreading.tasks import Cluster
from haptigraph.study.protocol import load_protocol
from haptigraph.study.simulated.participant import draw_participant


@pytest.fixture(scope="module")
def quick(tmp_path_factory):
    """The paper's protocol with short trials."""
    from importlib import resources

    text = (resources.files("haptigraph.study") / "templates" / "study.toml").read_text()
    folder = tmp_path_factory.mktemp("sweep")
    (folder / "study.toml").write_text(text.replace("timeout_s = 300", "timeout_s = 1.5"))
    return load_protocol(folder)


def test_every_combination_is_a_variation_and_none_is_as_drawn():
    assert variations_of([]) == (AS_DRAWN,)
    variations = variations_of(["align_share=0,0.5", "pace_mm_s=x2"])
    labels = [each.label for each in variations]
    assert labels == ["align_share=0 pace_mm_s=x2", "align_share=0.5 pace_mm_s=x2"]
    participant = draw_participant(1, 1)
    changed = replace(participant, align_share=0.5, pace_mm_s=2 * participant.pace_mm_s)
    assert variations[1](participant) == changed


@pytest.mark.parametrize(
    ("argument", "message"),
    [
        ("align=1", "--vary: unknown trait 'align'; did you mean 'align_share'"),
        ("align_share", "expected TRAIT=VALUE,VALUE"),
        ("align_share=", "expected a number of at least 0, or one with the prefix x, found ''"),
        ("align_share=much", "found 'much'"),
        ("align_share=-1", "found '-1'"),
        ("align_share=nan", "found 'nan'"),
        ("plan_s=0", "plan_s: expected a number above 0"),
    ],
)
def test_invalid_variations_are_refused(argument, message):
    with pytest.raises(BadInput) as error:
        variations_of([argument])
    assert message in str(error.value)


def test_a_trait_is_varied_once():
    with pytest.raises(BadInput, match="align_share is varied twice"):
        variations_of(["align_share=1", "align_share=2"])


def test_a_task_needs_no_file_and_gives_the_same_rows_anywhere(quick):
    task = Sweep(quick, 1, 1).task(AS_DRAWN, 0)
    task = replace(task, trials=task.trials[:1])
    (row,) = run_task(pickle.loads(pickle.dumps(task)))
    assert [row] == run_task(task)
    assert (row["participant"], row["simulated"], row["outcome"]) == ("S00001", 1, "timeout")
    assert row["time_misaligned_intraocular_navigation_s"] > 1


def kill_a_worker(done):
    if done == 1:
        worker = active_children()[0]
        os.kill(worker.pid, signal.SIGKILL)


@pytest.mark.slow  # `make test` kills workers of batches, in the same pool
def test_a_killed_worker_loses_no_result_and_stored_results_are_reused(quick, tmp_path):
    sweep, reports = Sweep(quick, 4, 1, variations_of(["align_share=0,1"])), []

    def watch(what, done, total):
        reports.append((done, total))
        kill_a_worker(done)

    rows, count = run_sweep(sweep, tmp_path / "out", workers=2, progress=watch)
    assert reports == [(done, 8) for done in range(9)]
    assert (count, len(rows)) == (8, 8 * 2)
    keys = [(row["variation"], row["participant"], row["position"]) for row in rows]
    assert len(set(keys)) == 16
    assert rows[:2] == run_task(sweep.task(sweep.variations[0], 0))
    assert run_sweep(sweep, tmp_path / "out") == (rows, 0)  # without a cluster
    fewer = Sweep(quick, 2, 1, sweep.variations[:1])
    assert run_sweep(fewer, tmp_path / "out") == (rows[:4], 0)


def test_a_cluster_is_used_by_its_address_and_must_have_the_same_version(quick, tmp_path, monkeypatch):
    settings = {"n_workers": 1, "processes": False, "dashboard_address": "127.0.0.1:0", "silence_logs": 50}
    with LocalCluster(**settings) as cluster:
        rows, count = run_sweep(
            Sweep(quick, 1, 1), tmp_path / "a", cluster=Cluster(cluster.scheduler_address)
        )
        assert (count, rows) == (1, run_task(Sweep(quick, 1, 1).task(AS_DRAWN, 0)))
        monkeypatch.setattr(spread, "_stamped", lambda work, task: ("0.0.9", work(task)))
        with pytest.raises(BadInput, match=r"its workers have haptigraph 0\.0\.9, this is "):
            run_sweep(Sweep(quick, 1, 1), tmp_path / "b", cluster=Cluster(cluster.scheduler_address))


def results_of(sweep, path):
    return closing(SweepResults(path, sweep.about(), sweep.simulate))


def test_results_of_different_sweeps_are_not_mixed(quick, tmp_path):
    path, sweep = tmp_path / "results.db", Sweep(quick, 1, 1)
    with results_of(sweep, path) as results:
        results.add("as drawn", 0, [{"a": 0.1}])
    with pytest.raises(BadInput, match="has other settings: seed was 1, is 2 now"):
        run_sweep(Sweep(quick, 1, 2), tmp_path)
    with results_of(sweep, path) as results:
        assert results.stored() == {("as drawn", 0)}
        assert list(results.trials("as drawn", 1)) == [{"a": 0.1}]


def test_a_sweep_of_another_version_or_wording_is_resumed_if_its_trials_are_reproduced(quick, tmp_path):
    path, sweep = tmp_path / "results.db", Sweep(quick, 1, 1)
    rows = sweep.simulate("as drawn", 0)
    with results_of(sweep, path) as results:
        results.add("as drawn", 0, [{**row, "software": "0.0.9"} for row in rows])
    reworded = replace(quick, parts={**quick.parts, "procedure subretinal_injection": "reworded"})
    with pytest.warns(UserWarning, match="protocol_sha256 changed since the sweep was started; continued"):
        assert run_sweep(replace(sweep, protocol=reworded), tmp_path)[1] == 0
    assert run_sweep(replace(sweep, protocol=reworded), tmp_path)[1] == 0  # without a warning
    for changed in ({**rows[0], "path_mm": rows[0]["path_mm"] * 1.001}, {**rows[0], "other": 1}):
        with results_of(replace(sweep, protocol=reworded), path) as results:
            results.add("as drawn", 0, [changed, *rows[1:]])
        with pytest.raises(BadInput, match="has other settings: protocol_sha256 was "):
            run_sweep(sweep, tmp_path)


def test_a_file_without_results_is_refused_and_not_modified(quick, tmp_path):
    (tmp_path / "results.db").write_bytes(b"not a database" * 100)
    with pytest.raises(BadInput, match="does not contain results of a sweep"):
        run_sweep(Sweep(quick, 1, 1), tmp_path)
    assert (tmp_path / "results.db").read_bytes() == b"not a database" * 100


def test_a_cluster_that_does_not_respond_is_reported(quick, tmp_path, monkeypatch):
    monkeypatch.setattr("haptigraph.spreading.cluster.TIMEOUT_S", 0.2)
    with pytest.raises(BadInput, match=r"tcp://127\.0\.0\.1:1: no scheduler responds"):
        run_sweep(Sweep(quick, 1, 1), tmp_path, cluster=Cluster("tcp://127.0.0.1:1"))


def test_the_summary_compares_with_the_first_condition_and_counts_people():
    rows = [
        {
            "variation": "as drawn",
            "participant": f"S{number}",
            "condition": condition,
            "block": 1,
            "phase": "trial",
            "trial": 1,
            "attempt": 1,
            "outcome": "hit" if number else "timeout",
            "completion_s": 10.0 + number + 2 * (condition == "felt") * (number % 3),
            "mean_theta_deg": 8.0 - 3 * (condition == "felt") - 0.1 * number * (condition == "seen"),
        }
        for number in range(13)
        for condition in ("felt", "seen")
    ]
    summary = sweep_summary(trials_table(rows), ["seen", "felt"])
    time, theta = (summary.iloc[row] for row in (0, 1))
    assert (time["n"], time["first"], time["second"]) == (12, "seen", "felt")  # one missed the target
    assert (time["first_mean"], time["difference"]) == (16.5, 2.0)
    assert theta["n"] == 13
    assert theta["difference"] == pytest.approx(-3 + 0.1 * 6)
    assert 3 <= theta["needed"] <= 10
    table = markdown(summary)
    assert table.startswith("SIMULATED") and "+2.00" in table
    assert not pd.isna(time["needed"])
