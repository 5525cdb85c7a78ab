"""Export a study from a store as tidy CSV with its data dictionary.

The data dictionary defines the columns of every table and their types. `SHA256SUMS` lists the checksum of
every file, as `sha256sum --check` reads it. Text that a spreadsheet would run as a formula is escaped.
"""

import csv
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any, TypeAlias

import msgspec
from msgspec import Struct
from msgspec.structs import replace
from sqlalchemy import select

from haptigraph.errors import BadInput
from haptigraph.folders import new_folder
from haptigraph.study.checksums import write_checksums
from haptigraph.study.data_dictionary import COLUMNS, Field, fields_of
from haptigraph.study.frozen.item_table import item_rows, typed_answer, value_kind
from haptigraph.study.frozen.parts import frozen_questionnaires
from haptigraph.study.protocol import Protocol
from haptigraph.study.questionnaire import Item
from haptigraph.study.store import Row, Store
from haptigraph.study.tables import (
    ANSWERS,
    CALIBRATION,
    EVENTS,
    PARTICIPANTS,
    SESSIONS,
    STAGES,
    STUDIES,
    TRIALS,
)

__all__ = [
    "FORMULA", "FROM_1", "ITEMS", "STUDY_FILE", "TABLES", "About", "Tables", "WriteTable", "about_study",
    "column_of", "export_study", "tidy_tables", "write_tables",
]  # fmt: skip

TABLES = {
    "participants": PARTICIPANTS,
    "sessions": SESSIONS,
    "stages": STAGES,
    "answers": ANSWERS,
    "calibration": CALIBRATION,
    "trials": TRIALS,
    "events": EVENTS,
}
"""In an order that respects foreign keys."""
FROM_1 = ("position", "block")  # stored as 0 where missing
WriteTable: TypeAlias = Callable[[Path, Sequence[Field], Sequence[Mapping[str, Any]]], None]
Tables: TypeAlias = dict[str, tuple[list[Field], list[dict[str, Any]]]]
"""Columns, and rows with None for missing values, by table."""
ITEMS = "questionnaire_items"
UNANSWERED = "not answered"
STUDY_FILE, DICTIONARY = "study.json", "data_dictionary.csv"
FORMULA = re.compile(r"'*[=+\-@\t\r]")  # after `'`, a spreadsheet shows it as text
PLAIN_NUMBER = re.compile(r"[+-]?\d+(\.\d+)?")


class About(Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True):
    """The frozen study: the content of an export's `study.json`."""

    study: str
    title: str
    simulated: int
    protocol_sha256: str
    parts: dict[str, str]
    software: str
    frozen_utc: str
    edited_parts: tuple[str, ...] | None = None
    """Parts whose files differed from the frozen ones when the study was exported; None: not compared."""


def tidy_tables(store: Store, study: str) -> Tables:
    """Return the tables of an export.

    Raises:
        BadInput: If the store has no such study.
    """
    about = about_study(store, study)
    tables = {}
    for name, table in TABLES.items():
        found = store.rows(select(table).where(table.c.study == study))
        key = [column.name for column in table.primary_key]
        rows = [_tidy(name, row) for row in sorted(found, key=lambda row: [row[part] for part in key])]
        if name == "trials":
            _add_attempt_reasons(rows)
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
                person[column_of(row)] = answer
    tables[ITEMS] = (fields_of(ITEMS), list(item_rows(study, about.parts)))
    return tables


def export_study(
    store: Store,
    study: str,
    folder: str | Path,
    more: Mapping[str, WriteTable] | None = None,
    protocol: Protocol | None = None,
) -> None:
    """Write a study into a new folder: CSV tables, their dictionary, the frozen protocol.

    Args:
        store: The store.
        study: The study's name.
        folder: The folder to create.
        more: Writers of additional formats, by file extension.
        protocol: That of the study's folder, whose edits are noted; None: it is not at hand.

    Raises:
        BadInput: If there is no such study, or the folder exists or cannot be written.
    """
    tables, about = tidy_tables(store, study), about_study(store, study)
    if protocol is not None:
        about = replace(about, edited_parts=tuple(protocol.changed_parts(about.parts)))
    with new_folder(Path(folder)) as temporary:
        write_tables(temporary, tables, about, more)
        write_checksums(temporary)


def write_tables(
    folder: Path, tables: Tables, about: About, more: Mapping[str, WriteTable] | None = None
) -> None:
    """Write tables, their dictionary and the frozen study into an existing folder."""
    for name, (fields, rows) in tables.items():
        _write(folder / f"{name}.csv", [field.name for field in fields], rows)
        for extension, write in (more or {}).items():
            write(folder / f"{name}.{extension}", fields, rows)
    dictionary = [_definition(field) for fields, _ in tables.values() for field in fields]
    _write(folder / DICTIONARY, list(dictionary[0]), dictionary)
    json = msgspec.json.format(msgspec.json.encode(about), indent=1)
    (folder / STUDY_FILE).write_bytes(json + b"\n")


def about_study(store: Store, study: str) -> About:
    """Return the frozen study.

    Raises:
        BadInput: If the store has no such study.
    """
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


def _add_attempt_reasons(rows: Sequence[dict[str, Any]]) -> None:
    """Derive why each attempt was made from the attempt before, in the row above."""
    for before, row in pairwise(({"outcome": None}, *rows)):
        after = "aborted" if before["outcome"] == "aborted" else "repeated"
        row["attempt_reason"] = "first" if row["attempt"] == 1 else after


def _demographics(answers: Iterable[Mapping[str, Any]], items: Mapping[tuple[str, str], Item]) -> list[Field]:
    """Return the columns of one-off answers, with kind, unit and wording of their items."""
    fields = {}
    for row in answers:
        name, item = column_of(row), items.get((row["questionnaire"], row["item"]))
        meaning = f"{row['questionnaire']}: {item.text if item else row['item']}"
        unit = item.unit if item else ""
        fields[name] = Field("participants", name, value_kind(item), unit, meaning, "participant", UNANSWERED)
    return list(fields.values())


def column_of(row: Mapping[str, Any]) -> str:
    """Return the column of participants for an answer to a one-off questionnaire."""
    item: str = row["item"]
    is_taken = item in [field.name for field in COLUMNS["participants"]]
    return f"{row['questionnaire']}_{item}" if is_taken else item


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
