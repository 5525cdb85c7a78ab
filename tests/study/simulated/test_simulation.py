"""A whole study with simulated participants: the same seed gives the same bytes despite interruptions."""

import signal
import subprocess
import sys
from contextlib import closing
from multiprocessing import active_children
from pathlib import Path

import msgspec
import pytest
from msgspec.structs import replace
from protocols import QUICK
from sqlalchemy import select

from haptigraph.analysis.metrics.replay import replay
from haptigraph.analysis.metrics.trial import measure_recording
from haptigraph.errors import BadInput
from haptigraph.recording.journal import not_being_written
from haptigraph.recording.reader import RunReader
from haptigraph.study.exchange.exporting import export_study
from haptigraph.study.preparation.calibration import Response, threshold_of
from haptigraph.study.protocol import load_protocol
from haptigraph.study.roster import Study
from haptigraph.study.runner import open_session
from haptigraph.study.simulated import player
from haptigraph.study.simulated.player import SimulationSpec
from haptigraph.study.simulated.simulation import simulate
from haptigraph.study.store import Store
from haptigraph.study.tables import ANSWERS, CALIBRATION, PARTICIPANTS, TRIALS


@pytest.fixture
def folder(tmp_path):
    """The folder of a study with short trials."""
    return new_study(tmp_path / "study")


@pytest.fixture(scope="module")
def reference(tmp_path_factory):
    """Two participants, simulated by one process: the settings, and what was simulated."""
    spec = spec_of(new_study(tmp_path_factory.mktemp("reference") / "study"))
    return spec, simulate(spec, 2)


def new_study(folder, text=QUICK):
    folder.mkdir()
    (folder / "study.toml").write_text(text)
    return folder


def spec_of(folder, seed=1, store=""):
    return SimulationSpec(str(folder), store or str(folder / "study.db"), seed)


def exported(spec, out):
    with closing(Store(spec.store)) as store:
        export_study(store, "small", out)
    return {path.name: path.read_bytes() for path in out.iterdir()}


def recordings(spec):
    folder = Path(spec.folder)
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*.mcap")}


def assert_same(one, other, tmp_path):
    assert exported(one, tmp_path / "export of one") == exported(other, tmp_path / "export of other")
    assert recordings(one) == recordings(other)


def test_the_same_seed_writes_the_same_bytes_in_one_process_or_two(reference, folder, tmp_path):
    spec, done = reference
    two = spec_of(folder)
    assert simulate(two, 2, workers=2) == done
    assert (done.participants, done.trials) == (2, 6)
    assert 6 * 2 <= done.steered_s <= 6 * 3.1
    assert_same(spec, two, tmp_path)
    assert simulate(two, 2).trials == 0  # all are complete


def test_another_seed_gives_other_recordings_which_are_marked_as_simulated(reference, folder):
    other = spec_of(folder, 2)
    simulate(other, 1)
    first, others = recordings(reference[0]), recordings(other)
    assert len(first) == 6 and len(others) == 3
    assert set(others) < set(first) and set(others.values()).isdisjoint(first.values())
    info = RunReader(folder / min(others)).info
    assert (info.source, info.participant) == ("phantom:simulated_participant", "S01")
    assert info.started_utc.startswith("2000-01-01T09:")
    assert measure_recording(folder / max(others))["path_mm"] > 0
    with pytest.raises(BadInput, match=r"\(perceiver ground-truth\)"):
        replay(folder / min(others))


KILLED = """
import os, signal, sys
from haptigraph.study.simulated import player, simulation


def recorder_of(rehearsal, path, started, real=player.recorder_of):
    recorder = real(rehearsal, path, started)
    if "S02" in path:
        recorder.write = lambda capture, step: os.kill(os.getpid(), signal.SIGKILL)
    return recorder


player.recorder_of = recorder_of
simulation.simulate(player.SimulationSpec(sys.argv[1], sys.argv[1] + "/study.db", 1), 2)
"""


def test_a_killed_simulation_is_resumed_with_the_same_results(reference, folder, tmp_path):
    killed = spec_of(folder)
    done = subprocess.run([sys.executable, "-c", KILLED, killed.folder])
    assert done.returncode == -signal.SIGKILL
    with closing(Store(killed.store)) as store:
        begun = [tuple(row.values()) for row in store.rows(select(TRIALS.c.participant, TRIALS.c.outcome))]
    assert len([each for each in begun if each[0] == "S01"]) == 3
    assert ("S02", None) in begun
    assert simulate(killed, 2).participants == 1
    assert_same(reference[0], killed, tmp_path)
    assert not list(folder.rglob("*.part"))


@pytest.mark.slow
def test_a_killed_workers_participants_are_simulated_again(reference, folder, tmp_path):
    spec = spec_of(folder)

    def kill(what, done, total):
        if done == 1:
            for process in active_children():
                process.kill()

    assert simulate(spec, 4, workers=2, progress=kill).participants == 4
    assert simulate(spec, 4).participants == 0


def test_what_cannot_be_simulated_is_refused_and_no_file_is_created(folder, tmp_path):
    with pytest.raises(BadInput, match="cannot simulate 5 of 4 participants"):
        simulate(spec_of(folder), 5)
    with (
        not_being_written(folder / "study.toml"),
        pytest.raises(BadInput, match="is being simulated by another program"),
    ):
        simulate(spec_of(folder), 1)
    assert [path.name for path in folder.iterdir()] == ["study.toml"]
    text = QUICK.replace('title = "Seen only"', 'title = "x"\nprocedure = "membrane_peeling"')
    peeling = new_study(tmp_path / "peeling", text)
    with pytest.raises(BadInput, match="membrane_peeling: has no state target_hit"):
        simulate(spec_of(peeling), 1)
    assert [path.name for path in peeling.iterdir()] == ["study.toml"]


def test_a_study_with_people_is_not_simulated(folder):
    with closing(Store(folder / "study.db")) as store:
        people = Study(load_protocol(folder), store)
        session = open_session(people, people.enrol("S01"), "lab")
        session.done("briefing")
        with pytest.raises(BadInput, match="has people; simulated participants need a study of another name"):
            simulate(spec_of(folder), 1)
        assert session.next().stage.key == "consent"


def test_a_simulation_is_resumed_with_the_same_settings_only(reference, monkeypatch):
    spec, file = reference[0], Path(reference[0].folder) / "study.toml"
    with pytest.raises(BadInput, match=r"was started as '.*seed 1.*', not as '.*seed 2"):
        simulate(replace(spec, seed=2), 3)
    file.write_text(QUICK + "# an afterthought\n")
    with pytest.raises(BadInput, match="was changed since"):
        simulate(spec, 3)
    file.write_text(QUICK)
    started = player.__version__
    monkeypatch.setattr(player, "__version__", "9.9")
    monkeypatch.setattr(player, "EQUIVALENT_VERSIONS", (started,))
    assert simulate(spec, 2).participants == 0
    monkeypatch.setattr(player, "EQUIVALENT_VERSIONS", ())
    with pytest.raises(BadInput, match=rf"haptigraph {started}', not as '.*haptigraph 9.9'"):
        simulate(spec, 3)
    with closing(Store(spec.store)) as store:
        assert len(store.rows(select(PARTICIPANTS))) == 2


@pytest.mark.slow
def test_parallel_simulation_in_postgresql_gives_the_same_data(reference, folder, tmp_path, server):
    """Two processes at one PostgreSQL store the same data as one process in SQLite."""
    import psycopg

    with psycopg.connect(server, autocommit=True) as connection:
        connection.execute("DROP SCHEMA public CASCADE")
        connection.execute("CREATE SCHEMA public")
    parallel = spec_of(folder, store=server)
    assert simulate(parallel, 2, workers=2) == reference[1]
    assert_same(reference[0], parallel, tmp_path)
    with closing(Store(server)) as store:
        assert len(store.rows(select(ANSWERS))) == 2 * 2 * 10
        assert len(store.rows(select(TRIALS))) == 2 * 3


def test_simulated_participants_calibrate_and_their_threshold_is_found(tmp_path):
    """The absolute threshold of every simulated participant is 0.05."""
    text = QUICK.replace("timeout_s = 2", "timeout_s = 2\nfree = false\nuntil_hits = 1\ntrials = 2")
    text = text.replace("touch = false", 'touch = "sham"')
    calibration = "[calibration]\nstimuli = 40\npresentations = 2\ntimes_threshold = 8.0\n"
    spec = spec_of(new_study(tmp_path / "study", text + calibration))
    simulate(spec, 1)
    with closing(Store(spec.store)) as store:
        rows = store.rows(select(CALIBRATION).order_by(CALIBRATION.c.task, CALIBRATION.c.number))
        trials = store.rows(select(TRIALS).order_by(TRIALS.c.started_utc))
    threshold = threshold_of(
        [Response("", row["amplitude"], row["response"]) for row in rows if row["task"] == "threshold"]
    )
    assert threshold.is_known and threshold.low <= 0.05 <= threshold.high and threshold.false_alarms == 0
    assert [row["correct"] for row in rows if row["task"] == "patterns"] == [1] * 6
    for trial in trials:
        path = Path(spec.folder) / trial["recording"]
        haptics = msgspec.json.decode(RunReader(path).info.config)["haptics"]
        assert haptics["weakest_amplitude"] == pytest.approx(8 * threshold.amplitude, abs=1e-4)
        assert haptics["sham_seed"] == (trial["seed"] if trial["condition"] == "seen" else None)
        measures = measure_recording(path)
        assert measures.get("touch") == ("sham" if trial["condition"] == "seen" else None)
        assert measures["weakest_amplitude"] == haptics["weakest_amplitude"]
    assert sum(trial["phase"] == "training" for trial in trials) == 2  # no hit in two seconds
