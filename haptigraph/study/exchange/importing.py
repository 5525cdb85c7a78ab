"""Import an export of a study into a store, without loss."""

import csv
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import msgspec
from msgspec import Struct
from sqlalchemy import Table, select

from haptigraph.errors import BadInput
from haptigraph.study.checksums import verify_checksums
from haptigraph.study.data_dictionary import COLUMNS, MEASURES, Field, check_measures, fields_of, time_field
from haptigraph.study.exchange.exporting import FORMULA, FROM_1, STUDY_FILE, TABLES, About
from haptigraph.study.roster import canonical, check_pseudonym
from haptigraph.study.store import Store, to_json
from haptigraph.study.tables import STUDIES

__all__ = ["Export", "import_study", "read_export"]

ABSENT = {"attempt_reason", *(field.name for field in MEASURES)}
"""Columns that an export of an earlier version may lack."""
LATER = ("calibration",)
"""Tables that exports of earlier versions lack."""


class Export(Struct, frozen=True):
    """An export that was read."""

    about: About
    rows: dict[str, list[dict[str, Any]]]
    """In the stored form, by table."""


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
    rows: dict[str, list[dict[str, Any]]] = {}
    for name in TABLES:
        if name in LATER and not (folder / f"{name}.csv").exists():
            rows[name] = []
            continue
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
        del row["edited_parts"]  # of the folder that was exported
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


def _text(value: str) -> str:
    """Return the text that was escaped."""
    return value[1:] if value.startswith("'") and FORMULA.match(value) else value


def _read(path: Path, table: str, study: str) -> Iterable[dict[str, Any]]:
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            reader = csv.DictReader(file, strict=True)
            fields = {field.name: field for field in fields_of(table, reader.fieldnames or ())}
            fields = {name: field for name, field in fields.items() if name in (reader.fieldnames or ())}
            missing = {field.name for field in COLUMNS[table]} - ABSENT - fields.keys()
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
