"""Batches: every recording once, whatever happens meanwhile, and a report that says what a replay says."""

import csv
import os
import pickle
import re
import shutil
import signal
import sys
from contextlib import closing
from multiprocessing import active_children

import pytest
from helpers import make_step

from haptigraph.analysis.batch.batch import Batch, open_results, run_batch
from haptigraph.analysis.batch.replaying import Moments
from haptigraph.analysis.batch.report import write_report
from haptigraph.analysis.exporting.csv_table import run_csv
from haptigraph.analysis.metrics.replay import replay
from haptigraph.errors import BadInput, MissingExtra

RUNS = ("recorded", "replayed")
NAMES = ["P01/run-0000.mcap", "P02/run-0040.mcap", "P03/run-0080.mcap", "P04/run-0120.mcap"]


@pytest.fixture
def wide(procedure, tmp_path):
    path = tmp_path / "wide.toml"
    path.write_text(procedure.text.replace("= 1.7", "= 4.0"))
    return str(path)


def rows_of(batch):
    with closing(open_results(batch)) as results:
        return [row[:3] for row in results.rows()]


def test_a_batch_replays_each_recording_as_replay_does(folder, wide, tmp_path):
    batch = Batch("replay", folder, tmp_path / "out", wide)
    reports = []
    ran = run_batch(batch, workers=2, progress=lambda *report: reports.append(report))
    assert (ran.now, ran.before) == (5, 0)
    assert reports == [("replaying", done, 5) for done in range(6)]
    rows = {name: (problem, result) for name, problem, result in rows_of(batch)}
    assert "damaged" in rows.pop("damaged.mcap")[0]
    assert list(rows) == NAMES
    for name, (problem, result) in rows.items():
        report = replay(folder / name, wide)
        assert problem == ""
        assert result["steps"] == report.steps
        assert result["states_differ"] == report.states_differ > 0
        assert result["haptics_differ"] == report.haptics_differ
        assert result["replayed"]["state_s"] == report.replayed.all_state_s
        assert result["states_differ_s"] == report.states.lasts_s > 0
        assert result["first_step"] == min(report.states.first_step, report.haptics.first_step)
    lines = write_report(batch, "http://127.0.0.1:1")
    assert lines[0] == "4 recordings, 1 passed over"
    of_all_s = sum(result["states_differ_s"] for _, result in rows.values())
    assert lines[1].startswith(f"states differ for {of_all_s:.2f} s in ")
    changes = [sum(result[run]["state_changes"] for _, result in rows.values()) for run in RUNS]
    assert f"state changes: {changes[0]} recorded, {changes[1]} replayed; alarms: " in lines[2]
    assert lines[-1].startswith("passed over: damaged.mcap: ") and "damaged" in lines[-1]
    page = (tmp_path / "out" / "report.html").read_text()
    assert "http://127.0.0.1:1/recordings#P01%2Frun-0000.mcap?step=" in page
    assert "copy wide.toml into the folder of recordings" in page and "&amp;with=" not in page
    for name, (_, result) in rows.items():
        row = re.search(rf">{name}</a></td>(.*?)</tr>", page)[1]
        assert f"<td>{result['states_differ_s']:.2f} s</td>" in row
        assert "<td>{} → {}</td>".format(*(result[run]["state_changes"] for run in RUNS)) in row
    with (tmp_path / "out" / "recordings.csv").open(newline="") as file:
        table = {row["recording"]: row for row in csv.DictReader(file)}
    assert list(table) == [*NAMES, "damaged.mcap"]
    assert table[NAMES[0]]["states_differ"] == str(rows[NAMES[0]][1]["states_differ"])


def test_killed_workers_and_interruptions_lose_nothing_and_repeat_nothing(
    folder, tmp_path, in_this_process, monkeypatch
):
    whole = Batch("replay", folder, tmp_path / "whole")
    run_batch(whole)
    monkeypatch.undo()
    broken = Batch("replay", folder, tmp_path / "broken")

    def kill(what, done, total):
        if done == 1:
            os.kill(active_children()[0].pid, signal.SIGKILL)
        if done == 3:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run_batch(broken, workers=2, progress=kill)
    ran = run_batch(broken, workers=2)
    assert (ran.now, ran.before) == (2, 3)
    assert rows_of(broken) == rows_of(whole)
    assert all(result["identical"] == result["steps"] for _, problem, result in rows_of(whole) if not problem)
    assert run_batch(broken).now == 0


@pytest.mark.usefixtures("in_this_process")
def test_what_has_changed_is_done_again_and_what_is_gone_is_removed(folder, tmp_path):
    batch = Batch("measure", folder, tmp_path / "out")
    run_batch(batch)
    assert rows_of(batch)[0][2]["contacts"] == 1
    os.utime(folder / NAMES[0])
    (folder / NAMES[1]).unlink()
    assert run_batch(batch).now == 1
    assert [row[0] for row in rows_of(batch)] == [NAMES[0], *NAMES[2:], "damaged.mcap"]


@pytest.mark.usefixtures("in_this_process")
def test_a_missing_extra_ends_the_batch_and_is_no_result(folder, tmp_path, monkeypatch):
    batch = Batch("measure", folder, tmp_path / "out")
    with monkeypatch.context() as patch:
        patch.setitem(sys.modules, "haptigraph.analysis.metrics.trial", None)
        with pytest.raises(MissingExtra, match=r"pip install 'haptigraph\[study\]'") as missing:
            run_batch(batch)
    assert str(pickle.loads(pickle.dumps(missing.value))) == str(missing.value)  # as a worker sends it
    assert rows_of(batch) == []
    assert run_batch(batch).now == 5
    assert [problem != "" for _, problem, _ in rows_of(batch)] == [False, False, False, False, True]


@pytest.mark.usefixtures("in_this_process")
def test_results_of_another_batch_are_not_mixed(folder, wide, tmp_path):
    run_batch(Batch("measure", folder, tmp_path / "out"))
    with pytest.raises(BadInput, match="results of another batch: kind was measure, is replay now"):
        run_batch(Batch("replay", folder, tmp_path / "out", wide))
    with pytest.raises(BadInput, match="is no folder"):
        run_batch(Batch("measure", folder / "none", tmp_path / "out"))


@pytest.mark.usefixtures("in_this_process")
def test_a_procedure_is_the_same_wherever_its_file_is_and_links_compare_once_the_page_has_it(
    folder, wide, tmp_path
):
    for name in NAMES[1:]:
        (folder / name).unlink()
    run_batch(Batch("replay", folder, tmp_path / "out", wide))
    copy = shutil.copy(wide, folder / "wide.toml")
    for procedure in (wide, str(copy)):
        again = Batch("replay", folder, tmp_path / "out", procedure)
        assert run_batch(again).now == 0
        lines = write_report(again, "http://127.0.0.1:1")
        assert lines[0] == "1 recording, 1 passed over"
        page = (tmp_path / "out" / "report.html").read_text()
        assert "&amp;with=wide.toml" in page and "copy wide.toml" not in page
    copy.write_text(copy.read_text().replace("= 4.0", "= 5.0"))
    with pytest.raises(BadInput, match=r"another batch: procedure was sha256 .*, is sha256 "):
        run_batch(Batch("replay", folder, tmp_path / "out", str(copy)))


@pytest.mark.usefixtures("in_this_process")
def test_an_export_writes_the_table_of_each_recording(folder, tmp_path):
    batch = Batch("export", folder, tmp_path / "out")
    run_batch(batch)
    run_csv(folder / NAMES[0], tmp_path / "expected.csv", name=NAMES[0].removesuffix(".mcap"))
    assert (tmp_path / "out" / NAMES[0]).with_suffix(".csv").read_bytes() == (
        tmp_path / "expected.csv"
    ).read_bytes()
    assert not (tmp_path / "out" / "damaged.csv").exists()


@pytest.mark.usefixtures("in_this_process")
@pytest.mark.parametrize(
    ("kind", "ending", "start"), [("parquet", ".parquet", b"PAR1"), ("foxglove", ".mcap", b"\x89MCAP0")]
)
def test_an_export_may_have_another_format(folder, tmp_path, kind, ending, start):
    pytest.importorskip("pyarrow" if kind == "parquet" else "mcap_protobuf")
    run_batch(Batch("export", folder, tmp_path / "out", format=kind))
    file = (tmp_path / "out" / NAMES[0]).with_suffix(ending)
    assert file.read_bytes().startswith(start)
    with pytest.raises(BadInput, match=f"results of another batch: format was {kind}, is csv now"):
        run_batch(Batch("export", folder, tmp_path / "out"))


@pytest.mark.usefixtures("in_this_process")
def test_perception_is_scored_with_the_ground_truth(folder, tmp_path):
    batch = Batch("evaluate", folder, tmp_path / "out")
    run_batch(batch)
    result = rows_of(batch)[0][2]
    assert result["images"] > 60
    assert result["tips"] == len(result["tip_errors_mm"]) > 0.9 * result["images"]
    assert sorted(result["tip_errors_mm"])[result["tips"] // 2] < 0.15
    lines = "\n".join(write_report(batch, ""))
    assert "tracker: tip reported in " in lines and "tracker: tip error [mm]" in lines
    with (tmp_path / "out" / "recordings.csv").open(newline="") as file:
        row = next(csv.DictReader(file))
    assert 0 < float(row["tip_errors_mm.median"]) < float(row["tip_errors_mm.p95"])


def test_alarms_are_gained_or_lost_only_without_any_in_the_other_run():
    kinds = {"calm": "neutral", "contact": "alarm"}
    moments = Moments(kinds, kinds)
    recorded = ["calm", "contact", "contact", "calm", "calm", "contact", "calm", "calm"]
    replayed = ["calm", "calm", "contact", "contact", "calm", "calm", "calm", "contact"]
    for number, states in enumerate(zip(recorded, replayed, strict=True)):
        moments.add(*(make_step(stamp_ns=number * 10**9, state=state) for state in states))
    found = moments.found()
    assert found["alarms_gained"] == [{"step": 7, "time_s": 7.0, "state": "contact"}]
    assert found["alarms_lost"] == [{"step": 5, "time_s": 5.0, "state": "contact"}]
    assert [(each["step"], each["steps"]) for each in found["changes"]] == [(1, 1), (3, 1), (5, 1), (7, 1)]
