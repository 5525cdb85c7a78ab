import csv
import json
import shutil
import subprocess
import sys
from contextlib import closing

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from protocols import SMALL
from sqlalchemy import select, update
from walking import TickingClock, do_next, fill, go_to

from haptigraph.errors import BadInput, MissingExtra
from haptigraph.study.data_dictionary import COLUMNS, MEASURES
from haptigraph.study.exchange.exporting import export_study, tidy_tables
from haptigraph.study.exchange.importing import import_study, read_export
from haptigraph.study.exchange.parquet import parquet_writer
from haptigraph.study.protocol import load_protocol
from haptigraph.study.roster import Study
from haptigraph.study.runner import open_session
from haptigraph.study.store import Store, to_json
from haptigraph.study.tables import EVENTS, METADATA, STUDIES, TRIALS

PROTOCOL = f"{SMALL}[calibration]\nstimuli = 0\npresentations = 1\n"


@pytest.fixture
def folder(folder):
    (folder / "study.toml").write_text(PROTOCOL)
    return folder


@pytest.fixture(scope="module")
def template(tmp_path_factory):
    """A folder with the study that `filled` copies."""
    folder = tmp_path_factory.mktemp("template")
    (folder / "study.toml").write_text(PROTOCOL)
    with closing(Store(folder / "study.db", TickingClock())) as store:
        fill_study(Study(load_protocol(folder), store))
    return folder


def fill_study(study):
    one = open_session(study, study.enrol(), "one")
    while one.next().stage is not None:
        do_next(one)
    one.close()
    two = open_session(study, study.enrol(), "two")
    two.begin_trial(go_to(two, "trial").key)
    two = open_session(study, "P02", "two")
    two.note('reports: "it itches",\nthen nothing\r\nmore; \u00fcber\u00e4ngstlich')
    fill(two, go_to(two, "questionnaire"), upto=3)
    study.enrol()
    study.withdraw("P03")


@pytest.fixture
def filled(template, tmp_path, clock):
    """One participant who is done, one within a questionnaire after a crash, one who withdrew."""
    folder = shutil.copytree(template, tmp_path, dirs_exist_ok=True)
    with closing(Store(folder / "study.db", clock)) as store:
        yield Study(load_protocol(folder), store)


def read(path):
    with path.open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def rows_of(store):
    return {
        table.name: sorted(map(str, (dict(row) for row in store.rows(select(table)))))
        for table in METADATA.sorted_tables
    }


def test_an_export_is_imported_without_loss(filled, tmp_path, where):
    export_study(filled.store, "small", tmp_path / "out")
    with closing(Store(where)) as other:
        import_study(other, read_export(tmp_path / "out"))
        assert rows_of(other) == rows_of(filled.store)
        export_study(other, "small", tmp_path / "again")
        for file in (tmp_path / "out").iterdir():
            assert (tmp_path / "again" / file.name).read_bytes() == file.read_bytes()
        with pytest.raises(BadInput, match="already contains study small; nothing was imported"):
            import_study(other, read_export(tmp_path / "out"))


@settings(max_examples=8, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    st.text(st.characters(codec="utf-8", exclude_characters="\0"), min_size=1).filter(str.strip),
    st.floats(allow_nan=False, allow_infinity=False),
)
def test_any_text_and_any_number_are_imported_unchanged(filled, tmp_path_factory, text, number):
    folder = tmp_path_factory.mktemp("export")
    store = filled.store
    with store.begin() as connection:
        connection.execute(update(EVENTS).values(text=text))
        connection.execute(
            update(TRIALS)
            .where(TRIALS.c.measures.is_not(None))
            .values(measures=f'{{"completion_s": {number!r}}}')
        )
    export_study(store, "small", folder / "out")
    with closing(Store(folder / "other.db")) as other:
        import_study(other, read_export(folder / "out"))
        assert rows_of(other) == rows_of(store)


def test_the_tables_are_tidy_and_every_column_is_in_the_dictionary(filled, tmp_path):
    out = tmp_path / "out"
    export_study(filled.store, "small", out)
    defined = {(row["table"], row["column"]) for row in read(out / "data_dictionary.csv")}
    for table in COLUMNS:
        rows = read(out / f"{table}.csv")
        assert rows, table
        assert {(table, name) for name in rows[0]} == {key for key in defined if key[0] == table}
    assert all(row["meaning"] and row["source"] for row in read(out / "data_dictionary.csv"))
    trials = read(out / "trials.csv")
    void = [row for row in trials if row["void"]]
    assert [(row["participant"], row["outcome"], row["void"], row["completion_s"]) for row in void] == [
        ("P02", "aborted", "interrupted", "")
    ]
    training = [row for row in trials if row["phase"] == "training"]
    assert {(row["position"], row["block"]) for row in training} == {("", "")}
    assert {row["completion_s"] for row in trials if not row["void"]} == {"2.5"}
    answers = read(out / "answers.csv")
    assert {row["position"] for row in answers} == {"1", "2"}
    assert all(row["condition"] in ("seen", "felt") for row in answers)
    assert [row["withdrawn_utc"] != "" for row in read(out / "participants.csv")] == [False, False, True]


def test_an_export_of_an_earlier_version_without_calibration_is_imported(filled, tmp_path):
    export_study(filled.store, "small", tmp_path / "out")
    for name in ("calibration.csv", "SHA256SUMS"):
        (tmp_path / "out" / name).unlink()
    with closing(Store(tmp_path / "other.db")) as other:
        import_study(other, read_export(tmp_path / "out"))
        rows = rows_of(other)
        assert rows.pop("calibration") == []
        assert rows == {name: each for name, each in rows_of(filled.store).items() if name != "calibration"}


def test_a_column_is_empty_only_where_the_dictionary_says_so(filled, tmp_path):
    out = tmp_path / "out"
    export_study(filled.store, "small", out)
    dictionary = read(out / "data_dictionary.csv")
    assert all(row["empty"] for row in dictionary)
    always = {(row["table"], row["column"]) for row in dictionary if row["empty"] == "never"}
    for table in COLUMNS:
        for row in read(out / f"{table}.csv"):
            assert not [name for name, value in row.items() if value == "" and (table, name) in always]
    assert ("trials", "trial") in always and not {("trials", field.name) for field in MEASURES} & always


def test_measures_of_quality_are_columns_where_a_trial_has_them(filled, tmp_path, where):
    quality = {"images_per_s": 29.5, "long_gaps": 2, "unseen_fraction": 0.1}
    with filled.store.begin() as connection:
        number = TRIALS.c.trial == 2
        connection.execute(update(TRIALS).where(number).values(measures=to_json(quality)))
    export_study(filled.store, "small", tmp_path / "out")
    trials = read(tmp_path / "out/trials.csv")
    assert {row["long_gaps"] for row in trials} == {"2", ""} and "longest_gap_s" not in trials[0]
    with closing(Store(where)) as other:
        import_study(other, read_export(tmp_path / "out"))
        assert rows_of(other) == rows_of(filled.store)


def test_demographics_are_columns_of_participants(folder, store):
    file = folder / "study.toml"
    file.write_text(file.read_text() + '\n[[questionnaire]]\nfile = "demographics"\nwhen = "start"\n')
    study = Study(load_protocol(folder), store)
    session = open_session(study, study.enrol(), "one")
    go_to(session, "training")
    fields, people = tidy_tables(store, "small")["participants"]
    assert (people[0]["age_years"], people[0]["gender"], people[0]["simulated"]) == (30.0, "female", 0)
    (age,) = (field for field in fields if field.name == "age_years")
    assert (age.kind, age.unit, age.meaning) == ("number", "years", "demographics: How old are you?")
    assert age.empty == "not answered"
    assert next(field.kind for field in fields if field.name == "gender") == "text"


def test_an_answer_to_an_item_that_cannot_be_read_stays_text(folder, store):
    file = folder / "study.toml"
    file.write_text(file.read_text() + '\n[[questionnaire]]\nfile = "demographics"\nwhen = "start"\n')
    session = open_session(study := Study(load_protocol(folder), store), study.enrol(), "one")
    go_to(session, "training")
    with store.begin() as connection:
        parts = json.dumps({**study.protocol.parts, "questionnaire demographics": "of a later version"})
        connection.execute(update(STUDIES).values(parts=parts))
    fields, people = tidy_tables(store, "small")["participants"]
    assert people[0]["age_years"] == "30"
    assert next(field.kind for field in fields if field.name == "age_years") == "text"


def test_wording_and_anchors_of_every_item_are_exported(filled, tmp_path):
    export_study(filled.store, "small", tmp_path / "out")
    items = read(tmp_path / "out" / "questionnaire_items.csv")
    assert [item["item"] for item in items] == [str(number) for number in range(1, 11)]
    first, second = items[:2]
    assert first["wording"] == "I think that I would like to use this system frequently."
    assert (first["low_label"], first["high_label"]) == ("Strongly disagree", "Strongly agree")
    assert (first["when"], first["low"], first["high"]) == ("condition", "1.0", "5.0")
    assert (first["reversed"], second["reversed"]) == ("0", "1")


def test_an_export_of_an_earlier_version_without_items_is_imported(filled, tmp_path, where):
    export_study(filled.store, "small", tmp_path / "out")
    for name in ("questionnaire_items.csv", "SHA256SUMS"):
        (tmp_path / "out" / name).unlink()
    with closing(Store(where)) as other:
        import_study(other, read_export(tmp_path / "out"))
        assert rows_of(other) == rows_of(filled.store)


def test_an_export_never_overwrites_and_leaves_no_incomplete_files(filled, tmp_path):
    (tmp_path / "out").mkdir()
    with pytest.raises(BadInput, match="exists already"):
        export_study(filled.store, "small", tmp_path / "out")
    with pytest.raises(BadInput, match="no study 'other'"):
        export_study(filled.store, "other", tmp_path / "new")
    with pytest.raises(BadInput, match="cannot be written"):
        export_study(filled.store, "small", tmp_path / "no" / "such")
    assert {path.name for path in tmp_path.iterdir()} <= {
        "out",
        "study.toml",
        "study.db",
        "study.db-wal",
        "study.db-shm",
        "recordings",
    }


@pytest.mark.parametrize(
    ("file", "valid", "invalid", "message"),
    [
        ("trials.csv", "2.5", "fast", r"trials.csv, line 2: completion_s: expected a number, found 'fast'"),
        ("trials.csv", "outcome", "result", r"trials.csv: column 'outcome' is missing"),
        (
            "answers.csv",
            "small,P01",
            "other,P01",
            r"answers.csv, line 2: belongs to study 'other', not 'small'",
        ),
        ("answers.csv", "small,P01", "P01", r"answers.csv, line 2: has a different number of values"),
        ("study.json", '"parts"', '"bits"', r"study.json: is damaged \(.*bits"),
    ],
)
def test_a_damaged_export_is_refused(filled, tmp_path, file, valid, invalid, message):
    export_study(filled.store, "small", tmp_path / "out")
    path = tmp_path / "out" / file
    (tmp_path / "out" / "SHA256SUMS").unlink()
    path.write_text(path.read_text().replace(valid, invalid, 1))
    with pytest.raises(BadInput, match=message):
        read_export(tmp_path / "out")
    with pytest.raises(BadInput, match="is not an export of a study"):
        read_export(tmp_path)


def test_an_export_says_why_each_attempt_was_made_and_older_exports_may_not(study, tmp_path):
    session = open_session(study, study.enrol(), "one")
    stage = go_to(session, "trial")
    for outcome in ("aborted", "hit"):
        session.begin_trial(stage.key)
        session.end_trial(outcome)
    session.repeat_trial(stage.key, "the phone rang")
    do_next(session)
    export_study(study.store, "small", tmp_path / "out")
    path = tmp_path / "out" / "trials.csv"
    rows = read(path)
    assert [row["attempt_reason"] for row in rows] == ["first", "first", "aborted", "repeated"]
    (tmp_path / "out" / "SHA256SUMS").unlink()
    with path.open("w", newline="", encoding="utf-8") as file:
        names = [name for name in rows[0] if name not in ("attempt_reason", "vibrating_s")]
        table = csv.DictWriter(file, names, extrasaction="ignore")
        table.writeheader()
        table.writerows(rows)
    with closing(Store(tmp_path / "copy.db")) as copy:
        import_study(copy, read_export(tmp_path / "out"))
        assert rows_of(copy) == rows_of(study.store)


def test_every_changed_byte_of_an_export_is_noticed(filled, tmp_path):
    export_study(filled.store, "small", tmp_path / "out")
    rng = np.random.default_rng(5)
    files = sorted((tmp_path / "out").glob("*.*"))
    assert len(files) == 10
    for file in files:
        whole = file.read_bytes()
        for at in rng.integers(0, len(whole), 20):
            changed = bytearray(whole)
            changed[at] ^= 1 << int(rng.integers(8))
            file.write_bytes(changed)
            with pytest.raises(
                BadInput, match=rf"{file.name}: was changed after the export.*delete SHA256SUMS"
            ):
                read_export(tmp_path / "out")
        file.unlink()
        with pytest.raises(BadInput, match=rf"{file.name}: cannot be read \(No such file"):
            read_export(tmp_path / "out")
        file.write_bytes(whole)
    read_export(tmp_path / "out")


@pytest.mark.skipif(shutil.which("sha256sum") is None, reason="no sha256sum here")
def test_checksums_are_those_of_sha256sum(filled, tmp_path):
    export_study(filled.store, "small", tmp_path / "out")
    subprocess.run(["sha256sum", "--check", "--strict", "SHA256SUMS"], cwd=tmp_path / "out", check=True)


@pytest.mark.parametrize("content", [b"\xff\n", b"abc\n", b"abc  ../study.db\n"])
def test_a_list_that_is_none_of_checksums_is_refused(filled, tmp_path, content):
    export_study(filled.store, "small", tmp_path / "out")
    (tmp_path / "out" / "SHA256SUMS").write_bytes(content)
    with pytest.raises(BadInput, match=r"SHA256SUMS.*(is not a list of checksums|expected a checksum)"):
        read_export(tmp_path / "out")


@pytest.mark.parametrize("file", ["study.json", "answers.csv"])
def test_an_export_that_is_not_utf8_is_refused(filled, tmp_path, file):
    export_study(filled.store, "small", tmp_path / "out")
    (tmp_path / "out" / "SHA256SUMS").unlink()
    path = tmp_path / "out" / file
    path.write_bytes(path.read_bytes().replace(b"small", b"sm\xff\xfel"))
    with pytest.raises(BadInput, match=rf"{file}: is "):
        read_export(tmp_path / "out")


@pytest.mark.parametrize(
    ("text", "cell"),
    [
        ("=cmd|' /C calc'!A0", "'=cmd|' /C calc'!A0"),
        ("+1+cmd", "'+1+cmd"),
        ("@SUM(A1)", "'@SUM(A1)"),
        ("-none-", "'-none-"),
        ("\t=1", "'\t=1"),
        ("'=1", "''=1"),
        ("-3", "-3"),
        ("+0.5", "+0.5"),
        ("it's = fine", "it's = fine"),
        ("'quoted'", "'quoted'"),
    ],
)
def test_a_formula_becomes_text_and_comes_back_unchanged(filled, tmp_path, text, cell):
    with filled.store.begin() as connection:
        connection.execute(update(EVENTS).values(text=text))
    export_study(filled.store, "small", tmp_path / "out")
    assert {row["text"] for row in read(tmp_path / "out" / "events.csv")} == {cell}
    assert {row["text"] for row in read_export(tmp_path / "out").rows["events"]} == {text}


def test_an_inconsistent_import_leaves_the_store_empty(filled, tmp_path):
    export_study(filled.store, "small", tmp_path / "out")
    path = tmp_path / "out" / "events.csv"
    (tmp_path / "out" / "SHA256SUMS").unlink()
    path.write_text(path.read_text().replace("small,P02", "small,P77", 1))
    with closing(Store(tmp_path / "other.db")) as other:
        with pytest.raises(BadInput, match="the database reported an error"):
            import_study(other, read_export(tmp_path / "out"))
        assert not any(rows_of(other).values())


@pytest.mark.parametrize(
    ("row", "message"),
    [
        ("small,P1,", r"participants\.csv, line 5: participant P1 is already in line 2"),
        (
            "small,Anna Meier,",
            r"participants\.csv, line 5: participants go by a pseudonym.*found 'Anna Meier'",
        ),
    ],
)
def test_an_export_with_a_duplicate_or_named_participant_is_refused(filled, tmp_path, row, message):
    export_study(filled.store, "small", tmp_path / "out")
    (tmp_path / "out" / "SHA256SUMS").unlink()
    path = tmp_path / "out" / "participants.csv"
    text = path.read_text()
    path.write_text(text + text.splitlines()[1].replace("small,P01,", row) + "\n")
    with pytest.raises(BadInput, match=message):
        read_export(tmp_path / "out")


def test_without_pyarrow_the_error_names_the_extra(monkeypatch):
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    with pytest.raises(MissingExtra, match=r"an export as Parquet needs an extra.*haptigraph\[parquet\]"):
        parquet_writer()


def test_measures_have_units_in_their_names():
    for field in MEASURES:
        suffixes = {"s": "_s", "deg": "_deg", "mm": "_mm", "mm^2": "_mm2", "ms": "_ms", "mm/s": "_mm_s"}
        assert field.name.endswith((suffixes | {"1/s": "_per_s", "": ""})[field.unit])
