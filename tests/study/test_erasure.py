import os
import signal
import sqlite3
import subprocess
import sys
from contextlib import closing
from pathlib import Path

import pytest
from helpers import mostly_slow
from protocols import SMALL
from sqlalchemy import select
from walking import do_next, go_to

from haptigraph.errors import BadInput, StoreFailed
from haptigraph.recording.journal import Journal
from haptigraph.study import store as stores
from haptigraph.study.erasure import erase, find_data, remaining_files
from haptigraph.study.exchange.exporting import export_study
from haptigraph.study.exchange.importing import import_study, read_export
from haptigraph.study.protocol import load_protocol
from haptigraph.study.roster import Study
from haptigraph.study.runner import open_session
from haptigraph.study.status import participant_statuses
from haptigraph.study.store import Store
from haptigraph.study.tables import METADATA

TEXTS = ("handedness unusual", "hesitated wonderfully", "fell asleep twice")
DELETED = "plays bassoon nightly"
on_sqlite = pytest.mark.parametrize("where", ["sqlite"], indirect=True)
mostly_on_sqlite = pytest.mark.parametrize(
    "where", mostly_slow(["sqlite", "postgresql"], "sqlite"), indirect=True
)
FREE = '[questionnaire]\nname = "free"\ntitle = "Free"\n[[item]]\nkey = "words"\ntext = "?"\nkind = "text"\n'


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "free.toml").write_text(FREE)
    (tmp_path / "study.toml").write_text(f'{SMALL}\n[[questionnaire]]\nfile = "free.toml"\nwhen = "start"\n')
    return tmp_path


@pytest.fixture
def study(protocol, where, clock):
    """P01 has completed the study, P02 a part, both with recordings; P03 has not begun."""
    with closing(Store(where, clock)) as store:
        study = Study(protocol, store)
        one = open_session(study, study.enrol(), "lab 1")
        while one.next().stage is not None:
            do_next(one)
        one.close()
        two = open_session(study, study.enrol(), "lab 2")
        key = go_to(two, "questionnaire").key
        two.answer(key, "words", DELETED)
        two.answer(key, "words", TEXTS[0])
        two.done(key)
        for number in range(60):
            two.note(f"{TEXTS[1]} {number}")
        two.begin_trial(two.next().stage.key)
        two.end_trial("aborted", void=TEXTS[2])
        two.close()
        study.enrol()
        record(protocol.folder, "P01", "trial-1-1-1-attempt1.mcap")
        record(protocol.folder, "P02", "training-0-0-1-attempt2.mcap", "a.unused1.mcap", "deep/b.mcap.part")
        yield study


def record(folder, participant, *names):
    for name in names:
        file = folder / "recordings" / participant / name
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_bytes(b"recorded")


def rows_of(store, participant):
    """Return all rows of a participant, by table."""
    return {
        table.name: [dict(row) for row in store.rows(select(table).where(table.c.participant == participant))]
        for table in METADATA.sorted_tables
        if "participant" in table.c
    }


def bytes_of(path):
    """Return all bytes of an SQLite store: the file, its log and its other files."""
    return b"".join(file.read_bytes() for file in path.parent.glob(f"{path.name}*"))


def test_erasing_keeps_pseudonym_and_slot_and_all_data_of_others(study, folder):
    before = {name: rows_of(study.store, name) for name in ("P01", "P02", "P03")}
    assert all(before["P02"][table] for table in ("answers", "events", "sessions", "stages", "trials"))
    erase(study, "P02")
    after = {name: rows_of(study.store, name) for name in before}
    assert (after["P01"], after["P03"]) == (before["P01"], before["P03"])
    (before_row,), (row,) = before["P02"].pop("participants"), after["P02"].pop("participants")
    assert not any(after["P02"].values())
    assert {name for name in row if row[name] == before_row[name]} == {
        "study", "participant", "slot", "conditions"
    }  # fmt: skip
    assert row["consented_utc"] is None and row["enrolled_utc"] == row["withdrawn_utc"]
    assert sorted(os.listdir(folder / "recordings")) == ["P01"]


@mostly_on_sqlite
def test_the_slot_is_reused_and_the_pseudonym_is_not(study):
    slots = {row["participant"]: (row["slot"], row["conditions"]) for row in study.participants()}
    erase(study, "P02")
    with pytest.raises(BadInput, match="already has a participant P02"):
        study.enrol("P02")
    with pytest.raises(BadInput, match="P02 has withdrawn; all data were erased"):
        open_session(study, "P02", "lab 2")
    assert study.enrol() == "P04"
    now = {row["participant"]: (row["slot"], row["conditions"]) for row in study.participants()}
    assert now == {**slots, "P04": slots["P02"]}
    statuses = {each.participant: (each.left, each.next.ended) for each in participant_statuses(study)}
    assert statuses["P02"] == (True, "the participant has withdrawn; all data were erased")
    assert statuses["P04"] == (False, "")


@mostly_on_sqlite
def test_participants_who_withdrew_or_never_began_are_erased_too(study):
    study.withdraw("P02")
    left = next(row for row in study.participants() if row["participant"] == "P02")
    for participant in ("P02", "P03"):
        erase(study, participant)
        assert find_data(study, participant).erased_utc
    assert find_data(study, "P02").erased_utc > left["withdrawn_utc"]
    with pytest.raises(BadInput, match="has already left the study"):
        study.withdraw("P03")


def test_participants_at_a_station_being_recorded_or_unknown_are_not_erased(study, folder):
    session = open_session(study, "P02", "lab 2")
    before = rows_of(study.store, "P02")
    for act in (find_data, erase):
        with pytest.raises(
            BadInput, match=r"P02 is at station lab 2 since 2026-11-21 09:.* leave the station first"
        ):
            act(study, "P02")
        with pytest.raises(BadInput, match=r"has no participant 'P09'; it has P01, P02, P03$"):
            act(study, "P09")
    assert rows_of(study.store, "P02") == before and len(remaining_files(folder, "P02")) == 3
    session.close()
    file = folder / "recordings/P02/a.unused1.mcap"
    journal = Journal(os.open(file, os.O_WRONLY))
    with pytest.raises(BadInput, match=r"a\.unused1\.mcap: is being written; end that run first"):
        find_data(study, "P02")
    journal.close()
    assert find_data(study, "P02").files


@mostly_on_sqlite
def test_the_data_found_are_all_files_recordings_elsewhere_and_aggregates(study, folder):
    session = open_session(study, "P02", "lab 7")
    session.begin_trial(session.next().stage.key)
    session.end_trial("aborted")
    session.close()
    (folder / "report" / "tables").mkdir(parents=True)
    (folder / "report" / "report.html").touch()
    (folder / "report" / "tables" / "participants.csv").touch()
    (folder / "recordings" / "archive").mkdir()
    (folder / "recordings" / "archive" / "runs.parquet").touch()
    found = find_data(study, "P02")
    assert found.rows == {"answers": 1, "events": 60, "sessions": 2, "stages": 3, "trials": 2}
    assert found.files == [
        f"recordings/P02/{name}"
        for name in ("a.unused1.mcap", "deep/b.mcap.part", "training-0-0-1-attempt2.mcap")
    ]
    assert found.elsewhere == ["recordings/P02/training-0-0-1-attempt1.mcap (station lab 2)"]
    assert found.aggregates == ["recordings/archive", "report", "report/tables"]
    assert (found.slot, found.erased_utc) == (1, "")


@on_sqlite
def test_erased_bytes_are_gone_from_sqlite(study):
    where = Path(study.store.name)
    before = bytes_of(where)
    assert all(text.encode() in before for text in (*TEXTS, "lab 2"))
    with closing(sqlite3.connect(where)) as other:  # data that an older version deleted without overwriting
        other.execute("PRAGMA secure_delete=OFF")
        other.execute("CREATE TABLE once AS SELECT ? AS words", [DELETED])
        other.execute("DROP TABLE once")
        other.commit()
    assert DELETED.encode() in bytes_of(where)
    erase(study, "P02")
    after = bytes_of(where)
    assert not any(text.encode() in after for text in (*TEXTS, DELETED, "lab 2"))
    assert b"P02" in after and b"lab 1" in after


@pytest.mark.parametrize("where", ["postgresql"], indirect=True)
def test_postgresql_rewrites_its_tables(study):
    def files():
        with study.store.begin() as connection:
            queries = (f"SELECT pg_relation_filenode('{name}')" for name in METADATA.tables)
            return [connection.exec_driver_sql(query).scalar() for query in queries]

    before = files()
    erase(study, "P02")
    assert not set(before) & set(files())


def test_a_deleted_answer_is_gone_once_the_log_is_closed(folder, protocol):
    where = folder / "study.db"
    with closing(Store(where)) as store:
        study = Study(protocol, store)
        session = open_session(study, study.enrol(), "one")
        key = go_to(session, "questionnaire").key
        session.answer(key, "words", DELETED)
        session.clear_answer(key, "words")
    assert DELETED.encode() not in bytes_of(where)


@on_sqlite
def test_while_another_program_reads_sqlite_erasing_fails_and_is_completed_afterwards(
    folder, protocol, study, monkeypatch
):
    where = Path(study.store.name)
    monkeypatch.setattr(stores, "BUSY_S", 0)
    with closing(Store(where)) as impatient, closing(sqlite3.connect(where)) as reader:
        reader.execute("BEGIN")
        reader.execute("SELECT * FROM trials").fetchall()
        with pytest.raises(StoreFailed, match="another program is reading it; end that first"):
            erase(Study(protocol, impatient), "P02")
    assert not any(find_data(study, "P02").rows.values()) and not remaining_files(folder, "P02")
    erase(study, "P02")
    assert not any(text.encode() in bytes_of(where) for text in TEXTS)


def test_an_error_of_the_store_leaves_rows_and_recordings_unchanged(study, folder, monkeypatch):
    before = rows_of(study.store, "P02")

    def fail(*_):
        raise StoreFailed("no more room")

    monkeypatch.setattr(study.store, "now_utc", fail)
    with pytest.raises(StoreFailed, match="no more room"):
        erase(study, "P02")
    assert rows_of(study.store, "P02") == before and len(remaining_files(folder, "P02")) == 3


KILLED = """
import os, shutil, signal, sys
from haptigraph.study.erasure import erase
from haptigraph.study.protocol import load_protocol
from haptigraph.study.roster import Study
from haptigraph.study.store import Store

shutil.rmtree = lambda path: os.kill(os.getpid(), signal.SIGKILL)
erase(Study(load_protocol(sys.argv[1]), Store(sys.argv[2])), "P02")
"""


def test_an_erasure_killed_between_rows_and_files_is_completed_by_a_second_one(study, folder, where):
    done = subprocess.run([sys.executable, "-c", KILLED, str(folder), where])
    assert done.returncode == -signal.SIGKILL
    interrupted = find_data(study, "P02")
    assert interrupted.erased_utc and not interrupted.rows and len(interrupted.files) == 3
    for _ in range(2):
        erase(study, "P02")
        again = find_data(study, "P02")
        assert (again.erased_utc, again.rows, again.files) == (interrupted.erased_utc, {}, [])
    if where.endswith(".db"):
        assert not any(text.encode() in bytes_of(Path(where)) for text in TEXTS)


@mostly_on_sqlite
def test_recordings_on_another_disk_are_erased_with_the_link_to_them(study, folder, tmp_path_factory):
    disk = tmp_path_factory.mktemp("disk") / "P02"
    (folder / "recordings" / "P02").rename(disk)
    (folder / "recordings" / "P02").symlink_to(disk)
    assert len(find_data(study, "P02").files) == 3
    erase(study, "P02")
    assert not disk.exists() and sorted(os.listdir(folder / "recordings")) == ["P01"]


@mostly_on_sqlite
def test_an_export_lists_erased_participants_and_is_imported_without_loss(study, folder, clock):
    erase(study, "P02")
    export_study(study.store, "small", folder / "out")
    texts = {file.name: file.read_text() for file in (folder / "out").iterdir()}
    assert {name for name, text in texts.items() if "P02" in text} == {"participants.csv"}
    with closing(Store(folder / "other.db", clock)) as other:
        import_study(other, read_export(folder / "out"))
        assert rows_of(other, "P02") == rows_of(study.store, "P02")
        assert find_data(Study(load_protocol(folder), other), "P02").erased_utc
