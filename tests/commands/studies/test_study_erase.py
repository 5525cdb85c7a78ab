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
from haptigraph.study.sharing.registry import Bundle, register
from haptigraph.study.store import Store
from haptigraph.study.tables import SESSIONS


@pytest.fixture
def folder(tmp_path):
    """A study in which P01 has begun, has a recording and has left the station."""
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


def has_data(folder):
    with closing(Store(folder / "study.db")) as store:
        rows = store.rows(select(SESSIONS))
    assert bool(rows) == (folder / "recordings" / "P01").exists()
    return bool(rows)


def test_a_dry_run_lists_the_data_without_erasing_them(folder):
    (folder / "out").mkdir()
    (folder / "out" / "participants.csv").touch()
    output = call("study", "erase", folder, "P01", "--dry-run")
    assert output.exit_code == 0
    assert output.stdout.splitlines() == [
        "P01: would be erased",
        "  rows of the store: events 1, sessions 1, stages 1; times of enrolment and consent",
        "  recordings/P01/training.mcap",
        "retained: the pseudonym, which is not reused, and place 1 in the counterbalancing",
        "contain all participants; delete them, then create them again",
        "  out",
        "delete or renew exports, reports, copies and backups elsewhere yourself",
        "nothing was erased",
    ]
    assert has_data(folder)


def test_recordings_at_another_station_are_listed(folder):
    with closing(Store(folder / "study.db")) as store:
        session = open_session(Study(load_protocol(folder), store), "P01", "lab 2")
        session.done("consent")
        for item in session.study.protocol.questionnaire("demographics").items:
            session.answer("questionnaire/demographics", item.key, item.choices[0] if item.choices else "30")
        session.done("questionnaire/demographics")
        session.begin_trial(session.next().stage.key)
        session.close()
    output = call("study", "erase", folder, "P01", "--dry-run").stdout
    assert "not in recordings/P01 here; run this again at the station that has them\n" in output
    assert "  recordings/P01/training-0-0-1-attempt1.mcap (station lab 2)\n" in output


def test_without_a_terminal_yes_is_required(folder):
    output = refuse("study", "erase", folder, "P01")
    assert "erasing P01 cannot be undone and needs confirmation at a terminal; give --yes" in output
    assert has_data(folder)
    done = call("study", "erase", folder, "P01", "--yes")
    assert done.exit_code == 0 and done.stdout.endswith("\nP01 is erased\n")
    assert not has_data(folder)
    for _ in range(2):
        again = call("study", "erase", folder, "P01")
        assert (again.exit_code, again.stdout) == (0, "no data of P01 are left here\n")


@pytest.mark.parametrize(
    ("answer", "code", "output"), [("n", 1, "nothing was erased"), ("y", 0, "P01 is erased")]
)
def test_at_a_terminal_it_asks_for_confirmation(folder, answer, code, output):
    pty = pytest.importorskip("pty")
    ours, theirs = pty.openpty()
    command = [sys.executable, "-m", "haptigraph", "study", "erase", str(folder), "P01"]
    with os.fdopen(ours, "wb") as keyboard, os.fdopen(theirs) as terminal:
        keyboard.write(f"{answer}\n".encode())
        keyboard.flush()
        done = subprocess.run(command, stdin=terminal, capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (code, "")
    assert (
        "recordings/P01/training.mcap" in done.stdout
        and "Erase all data of P01 permanently? [y/N]" in done.stdout
    )
    assert done.stdout.endswith(f"{output}\n")
    assert has_data(folder) == (answer == "n")


def test_an_impossible_erasure_is_refused_in_one_sentence(folder, tmp_path):
    assert "study sight_and_touch has no participant 'P07'; it has P01" in refuse(
        "study", "erase", folder, "P07", "--yes"
    )
    assert "study.toml" in refuse("study", "erase", tmp_path, "P01", "--yes")
    assert call("study", "new", tmp_path / "empty").exit_code == 0
    assert "the first enrolment creates it" in refuse("study", "erase", tmp_path / "empty", "P01", "--yes")
    with closing(Store(folder / "study.db")) as store:
        open_session(Study(load_protocol(folder), store), "P01", "one")
    assert "P01 is at station one since" in refuse("study", "erase", folder, "P01", "--yes")
    assert has_data(folder)


def test_status_and_check_count_withdrawals_and_list_remaining_files(folder):
    with closing(Store(folder / "study.db")) as store:
        study = Study(load_protocol(folder), store)
        study.enrol()
        study.withdraw("P02")
    assert call("study", "erase", folder, "P01", "--yes").exit_code == 0
    output = call("study", "status", folder).output
    assert "0 of 16 participants, 2 withdrew" in output
    assert "has withdrawn; all data were erased" in output
    checked = call("study", "check", folder)
    assert checked.exit_code == 0
    assert "2 withdrew, 1 of them with all data erased" in checked.output
    (folder / "recordings" / "P01").mkdir()
    (folder / "recordings" / "P01" / "late.mcap").touch()
    checked = call("study", "check", folder)
    assert checked.exit_code == 1
    assert (
        "recordings/P01/late.mcap of P01, whose data were erased, still exists; run `study erase` again"
        in checked.stderr
    )
    assert call("study", "erase", folder, "P01", "--yes").stdout.endswith("P01 is erased\n")
    assert call("study", "check", folder).exit_code == 0


def test_bundles_that_contain_a_participant_are_listed_before_and_after_the_erasure(folder):
    bundle = Bundle(str(folder / "bundle"), "2026-11-22T10:00:00+00:00", "ab" * 32, {"P01": "KXQV0142"})
    register(folder, bundle)
    line = f"  {folder}/bundle (as KXQV0142; made 2026-11-22, SHA-256 of SHA256SUMS abababababab...; no longer there"
    assert line in call("study", "erase", folder, "P01", "--yes").stdout
    assert line in call("study", "erase", folder, "P01").stdout
    lines = call("study", "check", folder).stdout.splitlines()
    assert f"bundle {folder}/bundle, 2026-11-22, participants: 1, no longer there" in lines
    assert "  contains data that were erased here: P01 as KXQV0142" in lines


def test_an_edited_protocol_does_not_prevent_erasure(folder):
    file = folder / "study.toml"
    file.write_text(file.read_text() + "\n# a remark\n")
    assert call("study", "erase", folder, "P01", "--yes").exit_code == 0
    assert not has_data(folder)
