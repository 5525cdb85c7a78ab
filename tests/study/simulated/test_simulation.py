"""A whole study with simulated participants: the same seed, the same bytes, whatever happens on the way."""

import signal
import subprocess
import sys
import time
from contextlib import closing
from multiprocessing import active_children
from pathlib import Path

import pytest
from msgspec.structs import replace
from protocols import QUICK
from sqlalchemy import select

from haptigraph.analysis.metrics.replay import replay
from haptigraph.analysis.metrics.trial import measure_recording
from haptigraph.errors import BadInput, HaptigraphError
from haptigraph.recording.journal import not_being_written
from haptigraph.recording.reader import RunReader
from haptigraph.study.exchange import export_study
from haptigraph.study.protocol import load_protocol
from haptigraph.study.roster import Study
from haptigraph.study.runner import open_session
from haptigraph.study.simulated.player import Cast
from haptigraph.study.simulated.simulation import simulate
from haptigraph.study.store import Store
from haptigraph.study.tables import ANSWERS, PARTICIPANTS, TRIALS


@pytest.fixture
def place(tmp_path):
    """The folder of a study whose trials are soon over."""
    return made(tmp_path / "study")


@pytest.fixture(scope="module")
def alone(tmp_path_factory):
    """Two participants, played by one process: how it shall be, and what was played."""
    cast = cast_of(made(tmp_path_factory.mktemp("alone") / "study"))
    return cast, simulate(cast, 2)


def made(folder, text=QUICK):
    folder.mkdir()
    (folder / "study.toml").write_text(text)
    return folder


def cast_of(folder, seed=1, store=""):
    return Cast(str(folder), store or str(folder / "study.db"), seed)


def exported(cast, out):
    with closing(Store(cast.store)) as store:
        export_study(store, "small", out)
    return {path.name: path.read_bytes() for path in out.iterdir()}


def recordings(cast):
    folder = Path(cast.folder)
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*.mcap")}


def assert_same(one, other, tmp_path):
    assert exported(one, tmp_path / "export of one") == exported(other, tmp_path / "export of other")
    assert recordings(one) == recordings(other)


def test_the_same_seed_writes_the_same_bytes_in_one_process_or_two(alone, place, tmp_path):
    cast, played = alone
    two = cast_of(place)
    assert simulate(two, 2, workers=2) == played
    assert (played.participants, played.trials) == (2, 6)
    assert 6 * 2 <= played.steered_s <= 6 * 3.1
    assert_same(cast, two, tmp_path)
    assert simulate(two, 2).trials == 0  # all have been through


def test_another_seed_writes_others_and_all_say_that_they_are_simulated(alone, place):
    other = cast_of(place, 2)
    simulate(other, 1)
    kept, others = recordings(alone[0]), recordings(other)
    assert len(kept) == 6 and len(others) == 3
    assert set(others) < set(kept) and set(others.values()).isdisjoint(kept.values())
    info = RunReader(place / min(others)).info
    assert (info.source, info.participant) == ("phantom:simulated_participant", "S01")
    assert info.started_utc.startswith("2000-01-01T09:")
    assert measure_recording(place / max(others))["path_mm"] > 0
    with pytest.raises(BadInput, match=r"was made without images \(perceiver known\)"):
        replay(place / min(others))


PLAYING = """
import sys
from haptigraph.study.simulated.player import Cast
from haptigraph.study.simulated.simulation import simulate
if __name__ == "__main__":
    simulate(Cast(sys.argv[1], sys.argv[1] + "/study.db", 1), 2)
"""


def test_killed_half_way_it_goes_on_and_all_is_as_if_nothing_had_happened(alone, place, tmp_path):
    cut, second = cast_of(place), place / "recordings" / "S02"
    with subprocess.Popen([sys.executable, "-c", PLAYING, cut.folder]) as process:
        while not (second.is_dir() and any(second.iterdir())):
            assert process.poll() is None
            time.sleep(0.01)
        process.send_signal(signal.SIGKILL)
    with closing(Store(cut.store)) as store:
        begun = [tuple(row.values()) for row in store.rows(select(TRIALS.c.participant, TRIALS.c.outcome))]
    assert len([each for each in begun if each[0] == "S01"]) == 3
    assert ("S02", None) in begun
    assert simulate(cut, 2).participants == 1
    assert_same(alone[0], cut, tmp_path)
    assert not list(place.rglob("*.part"))


@pytest.mark.slow
def test_killed_workers_end_it_with_one_sentence_and_it_goes_on(place):
    cast = cast_of(place)

    def kill(what, done, total):
        if done == 1:
            for process in active_children():
                process.kill()

    with pytest.raises(HaptigraphError, match="run the same again"):
        simulate(cast, 4, workers=2, progress=kill)
    done = simulate(cast, 4, workers=2).participants
    assert 1 <= done <= 3
    assert simulate(cast, 4).participants == 0


def test_what_cannot_be_simulated_is_refused_and_nothing_is_made(place, tmp_path):
    with pytest.raises(BadInput, match="takes 4 participants, found 5 to simulate"):
        simulate(cast_of(place), 5)
    with (
        not_being_written(place / "study.toml"),
        pytest.raises(BadInput, match="is being simulated by another program"),
    ):
        simulate(cast_of(place), 1)
    assert [path.name for path in place.iterdir()] == ["study.toml"]
    text = QUICK.replace('title = "Seen only"', 'title = "x"\nprocedure = "membrane_peeling"')
    peeling = made(tmp_path / "peeling", text)
    with pytest.raises(BadInput, match="membrane_peeling: has no state target_hit"):
        simulate(cast_of(peeling), 1)
    assert [path.name for path in peeling.iterdir()] == ["study.toml"]


def test_people_are_not_played_over(place):
    with closing(Store(place / "study.db")) as store:
        people = Study(load_protocol(place), store)
        session = open_session(people, people.enrol("S01"), "lab")
        session.done("briefing")
        with pytest.raises(BadInput, match="has people; simulated participants need a study of another name"):
            simulate(cast_of(place), 1)
        assert session.next().stage.key == "consent"


def test_what_was_begun_is_not_mixed_with_anything_else(alone):
    cast, file = alone[0], Path(alone[0].folder) / "study.toml"
    with pytest.raises(BadInput, match=r"was begun as '.*seed 1.*', not as '.*seed 2"):
        simulate(replace(cast, seed=2), 3)
    file.write_text(QUICK + "# an afterthought\n")
    with pytest.raises(BadInput, match="is not what it was then"):
        simulate(cast, 3)
    file.write_text(QUICK)
    with closing(Store(cast.store)) as store:
        assert len(store.rows(select(PARTICIPANTS))) == 2


@pytest.mark.xdist_group("postgresql")
def test_stations_at_one_postgresql_play_at_once_and_lose_and_double_nothing(alone, place, tmp_path, server):
    """Two processes answer and steer at the same time; what they keep is what one alone keeps in SQLite."""
    import psycopg

    with psycopg.connect(server, autocommit=True) as connection:
        connection.execute("DROP SCHEMA public CASCADE")
        connection.execute("CREATE SCHEMA public")
    together = cast_of(place, store=server)
    assert simulate(together, 2, workers=2) == alone[1]
    assert_same(alone[0], together, tmp_path)
    with closing(Store(server)) as store:
        assert len(store.rows(select(ANSWERS))) == 2 * 2 * 10
        assert len(store.rows(select(TRIALS))) == 2 * 3
