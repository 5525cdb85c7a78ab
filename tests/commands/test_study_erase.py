import os
import subprocess
import sys
from contextlib import closing

import pytest
from helpers import call, refuse
from sqlalchemy import select

from haptigraph.study.protocol import load_protocol
from haptigraph.study.roster import Study
from haptigraph.study.runner import open_session
from haptigraph.study.store import Store
from haptigraph.study.tables import SESSIONS


@pytest.fixture
def folder(tmp_path):
    """A study whose P01 has begun, is recorded and has left the station."""
    folder = tmp_path / "mine"
    assert call("study", "new", folder).exit_code == 0
    with closing(Store(folder / "study.db")) as store:
        study = Study(load_protocol(folder), store)
        session = open_session(study, study.enrol(), "one")
        session.done("briefing")
        session.note("hesitates")
        session.close()
    (folder / "recordings" / "P01").mkdir(parents=True)
    (folder / "recordings" / "P01" / "training.mcap").touch()
    return folder


def is_there(folder):
    with closing(Store(folder / "study.db")) as store:
        rows = store.rows(select(SESSIONS))
    assert bool(rows) == (folder / "recordings" / "P01").exists()
    return bool(rows)


def test_a_dry_run_lists_what_would_go_and_leaves_it(folder):
    (folder / "out").mkdir()
    (folder / "out" / "participants.csv").touch()
    told = call("study", "erase", folder, "P01", "--dry-run")
    assert told.exit_code == 0
    assert told.stdout.splitlines() == [
        "P01: what goes",
        "  rows of the store: events 1, sessions 1, stages 1; times of taking in and consent",
        "  recordings/P01/training.mcap",
        "what stays: the pseudonym, which is not given again, and place 1 with its order",
        "made of all participants; to be made anew",
        "  out",
        "exports, reports, copies and backups elsewhere are yours to make anew or delete",
        "nothing was erased",
    ]
    assert is_there(folder)


def test_a_recording_that_another_station_has_is_named(folder):
    with closing(Store(folder / "study.db")) as store:
        session = open_session(Study(load_protocol(folder), store), "P01", "lab 2")
        session.done("consent")
        for item in session.study.protocol.questionnaire("demographics").items:
            session.answer("questionnaire/demographics", item.key, item.choices[0] if item.choices else "30")
        session.done("questionnaire/demographics")
        session.begin_trial(session.next().stage.key)
        session.close()
    told = call("study", "erase", folder, "P01", "--dry-run").stdout
    assert "not in recordings/P01 here; run this again at the station that has them\n" in told
    assert "  recordings/P01/training-0-0-1-attempt1.mcap (station lab 2)\n" in told


def test_where_nobody_can_be_asked_it_needs_yes(folder):
    told = refuse("study", "erase", folder, "P01")
    assert "erasing P01 cannot be undone, and nobody is here to be asked; give --yes" in told
    assert is_there(folder)
    done = call("study", "erase", folder, "P01", "--yes")
    assert done.exit_code == 0 and done.stdout.endswith("\nP01 is erased\n")
    assert not is_there(folder)
    for _ in range(2):
        again = call("study", "erase", folder, "P01")
        assert (again.exit_code, again.stdout) == (0, "nothing of P01 is left here\n")


@pytest.mark.parametrize(
    ("answer", "code", "told"), [("n", 1, "nothing was erased"), ("y", 0, "P01 is erased")]
)
def test_at_a_terminal_it_asks_before_it_does_it(folder, answer, code, told):
    pty = pytest.importorskip("pty")
    ours, theirs = pty.openpty()
    command = [sys.executable, "-m", "haptigraph", "study", "erase", str(folder), "P01"]
    with os.fdopen(ours, "wb") as keyboard, os.fdopen(theirs) as terminal:
        keyboard.write(f"{answer}\n".encode())
        keyboard.flush()
        done = subprocess.run(command, stdin=terminal, capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (code, "")
    assert "recordings/P01/training.mcap" in done.stdout and "Erase P01 for good? [y/N]" in done.stdout
    assert done.stdout.endswith(f"{told}\n")
    assert is_there(folder) == (answer == "n")


def test_what_cannot_be_erased_is_refused_in_one_sentence(folder, tmp_path):
    assert "study sight_and_touch has no participant 'P07'; it has 1" in refuse(
        "study", "erase", folder, "P07", "--yes"
    )
    assert "study.toml" in refuse("study", "erase", tmp_path, "P01", "--yes")
    assert call("study", "new", tmp_path / "empty").exit_code == 0
    assert "kept from its first participant on" in refuse(
        "study", "erase", tmp_path / "empty", "P01", "--yes"
    )
    with closing(Store(folder / "study.db")) as store:
        open_session(Study(load_protocol(folder), store), "P01", "one")
    assert "P01 is at station one since" in refuse("study", "erase", folder, "P01", "--yes")
    assert is_there(folder)


def test_status_and_check_count_who_withdrew_and_see_what_was_left_behind(folder):
    with closing(Store(folder / "study.db")) as store:
        study = Study(load_protocol(folder), store)
        study.enrol()
        study.withdraw("P02")
    assert call("study", "erase", folder, "P01", "--yes").exit_code == 0
    told = call("study", "status", folder).output
    assert "0 of 16 participants, 2 withdrew" in told
    assert "has withdrawn, everything was erased" in told
    checked = call("study", "check", folder)
    assert checked.exit_code == 0
    assert "2 withdrew, 1 of them with all data erased" in checked.output
    (folder / "recordings" / "P01").mkdir()
    (folder / "recordings" / "P01" / "late.mcap").touch()
    checked = call("study", "check", folder)
    assert checked.exit_code == 1
    assert (
        "recordings/P01/late.mcap is still there of P01, who was erased; run `study erase` again"
        in checked.stderr
    )
    assert call("study", "erase", folder, "P01", "--yes").stdout.endswith("P01 is erased\n")
    assert call("study", "check", folder).exit_code == 0


def test_a_protocol_that_was_edited_keeps_nobody_from_being_erased(folder):
    file = folder / "study.toml"
    file.write_text(file.read_text() + "\n# a remark\n")
    assert call("study", "erase", folder, "P01", "--yes").exit_code == 0
    assert not is_there(folder)
