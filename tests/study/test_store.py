import signal
import sqlite3
import subprocess
import sys
from contextlib import closing

import pytest
from alembic.autogenerate import compare_metadata
from alembic.migration import MigrationContext
from sqlalchemy import select, text
from walking import do_next

from haptigraph.analysis.study.measures import measure_study
from haptigraph.errors import BadInput, MissingExtra, StoreFailed
from haptigraph.recording.reader import RunReader
from haptigraph.study import store as stores
from haptigraph.study.roster import Study
from haptigraph.study.runner import open_session
from haptigraph.study.store import Store
from haptigraph.study.tables import METADATA, TRIALS


def test_the_migrations_create_the_declared_tables(where):
    with closing(Store(where)) as store, store.begin() as connection:
        context = MigrationContext.configure(connection, opts={"compare_type": True})
        assert compare_metadata(context, METADATA) == []


def test_a_store_is_opened_again_unchanged_and_one_of_a_newer_version_is_refused(where, protocol):
    with closing(Store(where)) as store:
        Study(protocol, store).enrol("P01")
    with closing(Store(where)) as store:
        assert [row["participant"] for row in Study(protocol, store).participants()] == ["P01"]
        with store.begin() as connection:
            connection.execute(text("UPDATE alembic_version SET version_num = '9999'"))
    with pytest.raises(BadInput, match="created by a newer haptigraph"):
        Store(where)


def test_sqlite_is_set_to_durable_commits_and_secure_deletion(folder, store):
    with store.begin() as connection:
        settings = [
            connection.exec_driver_sql(f"PRAGMA {name}").scalar()
            for name in ("journal_mode", "synchronous", "foreign_keys", "secure_delete")
        ]
    assert settings == ["wal", 2, 1, 1]


@pytest.mark.parametrize(
    ("where", "message"),
    [
        ("no/such/folder/study.db", "its folder does not exist"),
        (".", "is a folder"),
        ("mysql://somewhere/study", "expected a file path or postgresql://"),
        ("nonsense://x", "expected a file path or postgresql://"),
        ("postgresql://me:secret@127.0.0.1:1/none", r"postgresql.*me:\*\*\*@127.*refused"),
    ],
)
def test_an_unusable_path_is_refused_without_revealing_the_password(where, message):
    with pytest.raises((BadInput, MissingExtra), match=message) as error:
        Store(where)
    assert "secret" not in str(error.value)


def test_opening_waits_for_a_store_that_another_station_is_creating(tmp_path, monkeypatch):
    with closing(sqlite3.connect(tmp_path / "new.db", isolation_level=None)) as other:
        other.execute("BEGIN IMMEDIATE")
        monkeypatch.setattr(stores.time, "sleep", lambda _: other.rollback())
        with closing(Store(tmp_path / "new.db")) as store:
            assert store.rows(select(TRIALS)) == []


def test_a_store_that_stays_locked_is_reported(tmp_path, monkeypatch):
    monkeypatch.setattr(stores, "BUSY_S", 0)
    with closing(sqlite3.connect(tmp_path / "new.db", isolation_level=None)) as other:
        other.execute("BEGIN IMMEDIATE")
        with pytest.raises(
            StoreFailed, match=r"new\.db: the database reported an error \(database is locked\)"
        ):
            Store(tmp_path / "new.db")


def test_a_file_that_is_not_a_store_is_refused_and_not_modified(tmp_path):
    file = tmp_path / "notes.db"
    file.write_bytes(b"not a database" * 100)
    with pytest.raises(
        BadInput, match=r"notes\.db: the database reported an error \(file is not a database\)"
    ):
        Store(file)
    assert file.read_bytes() == b"not a database" * 100


ANSWERING = """
import sys
from haptigraph.study.protocol import load_protocol
from haptigraph.study.roster import Study
from haptigraph.study.runner import open_session
from haptigraph.study.store import Store

study = Study(load_protocol(sys.argv[1]), Store(sys.argv[2]))
session = open_session(study, study.enrol("P01"), "here")
for key in ("briefing", "consent"):
    session.done(key)
session.begin_trial("training/0/0/1")
session.end_trial("timeout")
for trial in ("trial/1/1/1", "trial/1/1/2"):
    session.begin_trial(trial)
    session.end_trial("hit")
for item in range(1, 11):
    session.answer("questionnaire/sus/1", str(item), "4")
    print(item, flush=True)
"""


def test_every_answer_survives_a_killed_process(folder, protocol, where):
    command = [sys.executable, "-c", ANSWERING, str(folder), where]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        for line in process.stdout:
            if line == "4\n":
                break
        process.send_signal(signal.SIGKILL)
        last = [line for line in process.stdout if line.endswith("\n")]
    confirmed = {str(number) for number in range(1, 5 + len(last))}
    with closing(Store(where)) as store:
        study = Study(protocol, store)
        upcoming = open_session(study, "P01", "here").next()
    assert upcoming.stage.key == "questionnaire/sus/1"
    assert confirmed <= upcoming.answers.keys() <= {str(number) for number in range(1, 6 + len(last))}


def test_a_damaged_store_is_reported_in_one_sentence(folder, study):
    study.enrol()
    study.store.close()
    raw = sqlite3.connect(folder / "study.db")
    raw.execute("DROP TABLE events")
    raw.commit()
    raw.close()
    session = open_session(study, "P01", "here")
    with pytest.raises(
        BadInput, match=r"study\.db: the database reported an error \(no such table: events\)"
    ):
        session.note("something")


def test_without_the_extra_the_error_names_it():
    code = "import sys; sys.modules['sqlalchemy'] = None\nimport haptigraph.study.protocol, haptigraph.study.plan\nimport haptigraph.study.store"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert "pip install 'haptigraph[study]'" in done.stderr


def test_without_the_driver_the_error_names_the_extra(monkeypatch):
    monkeypatch.setitem(sys.modules, "psycopg", None)
    with pytest.raises(MissingExtra, match=r"haptigraph\[postgresql\]"):
        stores.Store("postgresql://host/none")


STEERING = """
import sys
import haptigraph
from haptigraph.study.protocol import load_protocol
from haptigraph.study.roster import Study
from haptigraph.study.runner import open_session
from haptigraph.study.store import Store

study = Study(load_protocol(sys.argv[1]), Store(sys.argv[1] + "/study.db"))
session = open_session(study, study.enrol("P01"), "here")
session.done("briefing")
session.done("consent")
settings = (f"source.uri={sys.argv[2]}", "source.loop=true", "run.realtime=false")
loop = haptigraph.build(session.config(haptigraph.load_config(None, settings)))
session.begin_trial("training/0/0/1")
for number, step in enumerate(loop.steps()):
    if number == 30:
        print("steering", flush=True)
"""


def test_a_trial_in_a_killed_process_is_stored_as_interrupted(folder, protocol, quick_uri):
    command = [sys.executable, "-c", STEERING, str(folder), quick_uri]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout.readline() == "steering\n"
        process.send_signal(signal.SIGKILL)
    with closing(Store(folder / "study.db")) as store:
        session = open_session(Study(protocol, store), "P01", "here")
        assert (session.next().stage.key, session.next().attempt) == ("training/0/0/1", 2)
        (row,) = store.rows(select(TRIALS))
        assert (row["outcome"], row["void"], row["recording_sha256"]) == ("aborted", "interrupted", None)
        assert not RunReader(folder / row["recording"]).is_whole
        assert measure_study(store, "small", folder) == []
        do_next(session)
        assert session.next().stage.key == "trial/1/1/1"
        assert len(store.rows(select(TRIALS))) == 2
