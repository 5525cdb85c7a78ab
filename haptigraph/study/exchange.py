"""Export a study from a store as tidy CSV or Parquet with its data dictionary; import it without loss.

The data dictionary defines the columns of every table and their types. `SHA256SUMS` lists the checksum of
every file, as `sha256sum --check` reads it. Text that a spreadsheet would run as a formula is escaped.
"""

import csv
import os
import re
import shutil
import tempfile
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeAlias

import msgspec
from msgspec import Struct
from sqlalchemy import Table, select

from haptigraph.errors import BadInput, MissingExtra
from haptigraph.study.checksums import verify_checksums, write_checksums
from haptigraph.study.data_dictionary import COLUMNS, MEASURES, Field, check_measures, fields_of, time_field
from haptigraph.study.frozen.item_table import item_rows, typed_answer, value_kind
from haptigraph.study.frozen.parts import frozen_questionnaires
from haptigraph.study.questionnaire import Item
from haptigraph.study.roster import canonical, check_pseudonym
from haptigraph.study.store import Row, Store, to_json
from haptigraph.study.tables import ANSWERS, EVENTS, PARTICIPANTS, SESSIONS, STAGES, STUDIES, TRIALS

__all__ = ["About", "Export", "export_study", "import_study", "parquet_writer", "read_export", "tidy_tables"]

TABLES = {
    "participants": PARTICIPANTS,
    "sessions": SESSIONS,
    "stages": STAGES,
    "answers": ANSWERS,
    "trials": TRIALS,
    "events": EVENTS,
}
"""In an order that respects foreign keys."""
FROM_1 = ("position", "block")  # stored as 0 where missing
WriteTable: TypeAlias = Callable[[Path, Sequence[Field], Sequence[Mapping[str, Any]]], None]
ITEMS = "questionnaire_items"
UNANSWERED = "not answered"
STUDY_FILE, DICTIONARY = "study.json", "data_dictionary.csv"
FORMULA = re.compile(r"'*[=+\-@\t\r]")  # after `'`, a spreadsheet shows it as text
PLAIN_NUMBER = re.compile(r"[+-]?\d+(\.\d+)?")


class About(Struct, frozen=True, forbid_unknown_fields=True):
    """The frozen study: the content of an export's `study.json`."""

    study: str
    title: str
    simulated: int
    protocol_sha256: str
    parts: dict[str, str]
    software: str
    frozen_utc: str


class Export(Struct, frozen=True):
    """An export that was read."""

    about: About
    rows: dict[str, list[dict[str, Any]]]
    """In the stored form, by table."""


def tidy_tables(store: Store, study: str) -> dict[str, tuple[list[Field], list[dict[str, Any]]]]:
    """Return the tables of an export: columns, and rows with None for missing values.

    Raises:
        BadInput: If the store has no such study.
    """
    about = _about(store, study)
    tables = {}
    for name, table in TABLES.items():
        found = store.rows(select(table).where(table.c.study == study))
        key = [column.name for column in table.primary_key]
        rows = [_tidy(name, row) for row in sorted(found, key=lambda row: [row[part] for part in key])]
        tables[name] = (fields_of(name, (key for row in rows for key in row)), rows)
    fields, people = tables["participants"]
    one_off = [row for row in tables["answers"][1] if row["position"] is None]
    questionnaires = {each.name: each for each in frozen_questionnaires(about.parts).values()}
    items = {(name, item.key): item for name, each in questionnaires.items() for item in each.items}
    fields += _demographics(one_off, items)
    for person in people:
        person["simulated"] = about.simulated
        for row in one_off:
            if row["participant"] == person["participant"]:
                answer = typed_answer(items.get((row["questionnaire"], row["item"])), row["answer"])
                person[_column(row, COLUMNS["participants"])] = answer
    tables[ITEMS] = (fields_of(ITEMS), list(item_rows(study, about.parts)))
    return tables


def export_study(
    store: Store, study: str, folder: str | Path, more: Mapping[str, WriteTable] | None = None
) -> None:
    """Write a study into a new folder: CSV tables, their dictionary, the frozen protocol.

    Args:
        store: The store.
        study: The study's name.
        folder: The folder to create.
        more: Writers of additional formats, by file extension.

    Raises:
        BadInput: If there is no such study, or the folder exists or cannot be written.
    """
    folder = Path(folder)
    tables, about = tidy_tables(store, study), _about(store, study)
    if folder.exists():
        raise BadInput("exists already; an export never overwrites", folder)
    try:
        temporary = Path(tempfile.mkdtemp(prefix=f".{folder.name}-", dir=folder.parent))
        try:
            for name, (fields, rows) in tables.items():
                _write(temporary / f"{name}.csv", [field.name for field in fields], rows)
                for extension, write in (more or {}).items():
                    write(temporary / f"{name}.{extension}", fields, rows)
            dictionary = [_definition(field) for fields, _ in tables.values() for field in fields]
            _write(temporary / DICTIONARY, list(dictionary[0]), dictionary)
            json = msgspec.json.format(msgspec.json.encode(about), indent=1)
            (temporary / STUDY_FILE).write_bytes(json + b"\n")
            write_checksums(temporary)
            temporary.chmod(0o755)
            os.rename(temporary, folder)
        except BaseException:
            shutil.rmtree(temporary, ignore_errors=True)
            raise
    except OSError as error:
        raise BadInput(f"cannot be written ({error.strerror})", folder) from None


def parquet_writer() -> WriteTable:
    """Return a writer of Parquet tables; their column metadata holds unit and meaning.

    Raises:
        MissingExtra: If pyarrow is not installed.
    """
    try:
        import pyarrow as pa  # noqa: PLC0415
        from pyarrow import parquet  # noqa: PLC0415
    except ModuleNotFoundError:
        raise MissingExtra("an export as Parquet", "parquet") from None
    types = {"text": pa.string(), "integer": pa.int64(), "number": pa.float64()}

    def write(path: Path, fields: Sequence[Field], rows: Sequence[Mapping[str, Any]]) -> None:
        columns = [
            pa.field(field.name, types[field.kind], metadata={"unit": field.unit, "meaning": field.meaning})
            for field in fields
        ]
        table = [{field.name: row.get(field.name) for field in fields} for row in rows]
        parquet.write_table(pa.Table.from_pylist(table, pa.schema(columns)), path)

    return write


def read_export(folder: str | Path) -> Export:
    """Read an export; one without checksums is not verified.

    Raises:
        BadInput: If a file cannot be read, differs from its checksum, or its content is invalid.
    """
    folder = Path(folder)
    verify_checksums(folder)
    try:
        about = msgspec.json.decode((folder / STUDY_FILE).read_bytes(), type=About)
    except OSError as error:
        raise BadInput(f"is not an export of a study ({error.strerror}: {STUDY_FILE})", folder) from None
    except (msgspec.MsgspecError, UnicodeDecodeError) as error:
        raise BadInput(f"is damaged ({error})", folder / STUDY_FILE) from None
    rows = {}
    for name in TABLES:
        rows[name] = [_stored(name, row) for row in _read(folder / f"{name}.csv", name, about.study)]
    _check_participants(folder / "participants.csv", rows["participants"])
    return Export(about, rows)


def import_study(store: Store, export: Export) -> None:
    """Insert an export into a store that does not contain the study, in one transaction.

    Raises:
        BadInput: If the store contains the study, or rows contradict each other.
    """
    about = export.about
    with store.begin() as connection:
        existing = select(STUDIES.c.study).where(STUDIES.c.study == about.study)
        if connection.execute(existing).first() is not None:
            raise BadInput(f"already contains study {about.study}; nothing was imported", store.name)
        row = {**msgspec.structs.asdict(about), "parts": to_json(about.parts)}
        connection.execute(STUDIES.insert().values(row))
        for name, table in TABLES.items():
            if export.rows[name]:
                connection.execute(table.insert(), export.rows[name])


def _check_participants(path: Path, rows: Sequence[Mapping[str, Any]]) -> None:
    lines: dict[object, int] = {}
    for line, row in enumerate(rows, 2):
        name = row["participant"] or ""
        try:
            check_pseudonym(name)
        except BadInput as error:
            raise BadInput(error.problem, path, f"line {line}") from None
        first = lines.setdefault(canonical(name), line)
        if first != line:
            raise BadInput(f"participant {name} is already in line {first}", path, f"line {line}")


def _about(store: Store, study: str) -> About:
    row = next(iter(store.rows(select(STUDIES).where(STUDIES.c.study == study))), None)
    if row is None:
        raise BadInput(f"has no study {study!r}; the first enrolment stores a study", store.name)
    return About(**{**row, "parts": msgspec.json.decode(row["parts"])})


def _tidy(table: str, row: Row) -> dict[str, Any]:
    """Convert a stored row into an exported one."""
    tidy = {name: None if name in FROM_1 and value == 0 else value for name, value in row.items()}
    if table == "trials":
        tidy |= msgspec.json.decode(tidy.pop("measures") or "{}")
    if table == "participants":
        tidy["order"] = tidy.pop("conditions")
    return tidy


def _stored(table: str, row: dict[str, Any]) -> dict[str, Any]:
    """Convert an exported row back into a stored one."""
    stored = {name: 0 if name in FROM_1 and value is None else value for name, value in row.items()}
    if table == "trials":
        names = [name for name in stored if time_field(name) or name in {field.name for field in MEASURES}]
        measures = check_measures({name: stored.pop(name) for name in names})
        stored["measures"] = to_json(measures) if measures else None
    if table == "participants":
        stored["conditions"] = stored.pop("order")
    columns: Table = TABLES[table]
    return {name: value for name, value in stored.items() if name in columns.c}


def _demographics(answers: Iterable[Mapping[str, Any]], items: Mapping[tuple[str, str], Item]) -> list[Field]:
    """Return the columns of one-off answers, with kind, unit and wording of their items."""
    fields = {}
    for row in answers:
        name, item = _column(row, COLUMNS["participants"]), items.get((row["questionnaire"], row["item"]))
        meaning = f"{row['questionnaire']}: {item.text if item else row['item']}"
        unit = item.unit if item else ""
        fields[name] = Field("participants", name, value_kind(item), unit, meaning, "participant", UNANSWERED)
    return list(fields.values())


def _column(row: Mapping[str, Any], fields: Sequence[Field]) -> str:
    """Return the column for an answer to a one-off questionnaire."""
    item: str = row["item"]
    return f"{row['questionnaire']}_{item}" if item in [field.name for field in fields] else item


def _definition(field: Field) -> dict[str, Any]:
    row = field._asdict()
    return {"table": row.pop("table"), "column": row.pop("name"), **row}


def _write(path: Path, names: list[str], rows: Iterable[Mapping[str, Any]]) -> None:
    with path.open("w", newline="", encoding="utf-8") as file:
        table = csv.DictWriter(file, names, restval="")
        table.writeheader()
        table.writerows(
            {name: _escaped(row.get(name)) for name in names} for row in rows
        )  # floats read back equal


def _escaped(value: Any) -> Any:
    """Return a value of a table so that no spreadsheet runs it as a formula; None becomes empty."""
    is_formula = isinstance(value, str) and FORMULA.match(value) and not PLAIN_NUMBER.fullmatch(value)
    return f"'{value}" if is_formula else value


def _text(value: str) -> str:
    """Return the text that was escaped."""
    return value[1:] if value.startswith("'") and FORMULA.match(value) else value


def _read(path: Path, table: str, study: str) -> Iterable[dict[str, Any]]:
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            reader = csv.DictReader(file, strict=True)
            fields = {field.name: field for field in fields_of(table, reader.fieldnames or ())}
            missing = fields.keys() - set(reader.fieldnames or ())
            if missing:
                raise BadInput(f"column {min(missing)!r} is missing", path)
            for row in reader:
                place = f"line {reader.line_num}"
                if None in row or None in row.values():
                    raise BadInput("has a different number of values than columns", path, place)
                if row["study"] != study:
                    raise BadInput(f"belongs to study {row['study']!r}, not {study!r}", path, place)
                yield {name: _value(fields[name], row[name], path, place) for name in fields}
    except OSError as error:
        raise BadInput(f"cannot be read ({error.strerror})", path) from None
    except (csv.Error, UnicodeDecodeError) as error:
        raise BadInput(f"is not CSV in UTF-8 ({error})", path) from None


_FROM_TEXT: dict[str, Callable[[str], Any]] = {"text": _text, "integer": int, "number": float}


def _value(field: Field, text: str, path: Path, place: str) -> Any:
    if text == "":
        return None
    try:
        return _FROM_TEXT[field.kind](text)
    except ValueError:
        kind = {"integer": "a whole number", "number": "a number"}[field.kind]
        raise BadInput(f"{field.name}: expected {kind}, found {text[:40]!r}", path, place) from None
