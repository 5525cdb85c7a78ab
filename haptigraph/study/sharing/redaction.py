"""Turn the tables of an export into those that may be published.

Left out are free text, the experimenter's words, recordings without consent, and the data of whoever withdrew
or never consented. Participants get new names; everyone's time begins at the same moment. A column of text is
published only if `PUBLISHED` lists it.
"""

from collections import Counter
from collections.abc import Collection, Iterable, Mapping
from typing import Any

from msgspec import Struct

from haptigraph.errors import BadInput, unknown_name
from haptigraph.study.data_dictionary import COLUMNS, Field
from haptigraph.study.exchange import Tables, column_of
from haptigraph.study.questionnaire import Item, Questionnaire, Shared
from haptigraph.study.sharing.rekeying import ORIGIN, shifted

__all__ = ["HANDLED", "PUBLISHED", "Redacted", "redacted", "unique_people"]

PUBLISHED = {
    *("study", "condition", "phase", "target", "outcome", "state_order", "procedure_sha256", "software"),
    *("questionnaire", "item", "order", "stage", "kind"),
}
"""Columns of text that name nobody: they contain names from the protocol, and the program's own words."""
HANDLED = {"participant", "answer", "void", "recording", "recording_sha256"}
"""Columns of text that are published in part or in another form."""
IDENTIFYING = {"slot", "seed"}
"""Numbers that show who enrolled when."""
OWN_REASONS = {"interrupted", "aborted"}
REASON = "reason left out"
ORIGIN_NOTE = f"; counted from the participant's enrolment, which is set to {ORIGIN:%Y-%m-%d} for everyone"


class Redacted(Struct, frozen=True):
    """Tables that may be published."""

    tables: Tables
    recordings: list[dict[str, Any]]
    """The original rows of the trials whose recordings may be published."""
    present: list[str]
    """Pseudonyms of the participants whose data are included."""
    left_out: dict[str, int]
    """How much is missing, by what it is."""


def redacted(
    tables: Tables,
    questionnaires: Collection[Questionnaire],
    names: Mapping[str, str],
    without: Collection[str],
) -> Redacted:
    """Return the tables that may be published.

    Args:
        tables: Those of an export.
        questionnaires: The frozen ones.
        names: The new name of each pseudonym.
        without: Columns of `participants` that are to be left out with their answers.

    Raises:
        BadInput: If there is no such column.
    """
    people = {row["participant"]: row for row in tables["participants"][1]}
    present = {name for name, row in people.items() if row["consented_utc"] and not row["withdrawn_utc"]}
    items = {(each.name, item.key): item for each in questionnaires for item in each.items}
    answers = tables["answers"][1]
    _check_columns(without, answers)
    allowed = {
        name: _allowed([row for row in answers if row["participant"] == name], items) for name in present
    }
    left_out: Counter[str] = Counter()
    hidden: set[tuple[str, str]] = set()
    published: Tables = {}
    for table in sorted(tables, key=lambda name: name != "answers"):  # first, as participants repeat them
        fields, rows = tables[table]
        kept = []
        for row in rows:
            name = row["participant"]
            if table == "answers" and (
                name not in present or not _is_published(row, items, allowed, without, left_out)
            ):
                if row["position"] is None:
                    hidden.add((name, column_of(row)))
            elif table == "participants" or name in present:
                kept.append(_published_row(table, row, people[name], names, hidden, left_out))
        columns = [_redated(field) for field in fields if _is_column(table, field, kept)]
        published[table] = columns, sorted(kept, key=lambda row: row["participant"])
    recordings = [
        row for row in tables["trials"][1] if row["recording_sha256"] and row["participant"] in present
    ]
    shared = [row for row in recordings if "recordings" in allowed[row["participant"]]]
    left_out["recordings"] += len(recordings) - len(shared)
    left_out["participants who withdrew, or did not consent, with all their rows"] += len(people) - len(
        present
    )
    ordered = {name: published[name] for name in tables}
    return Redacted(
        ordered, shared, sorted(present), {what: count for what, count in left_out.items() if count}
    )


def unique_people(tables: Tables, questionnaires: Iterable[Questionnaire]) -> tuple[list[str], list[str]]:
    """Return the columns of `participants` that others may know, and whose combination of them is unique."""
    facts = {
        item.key
        for each in questionnaires
        for item in each.items
        if item.kind in ("choice", "number") and not item.shares
    }
    one_off = [row for row in tables["answers"][1] if row["position"] is None and row["item"] in facts]
    columns = sorted({column_of(row) for row in one_off})
    answered = {row["participant"] for row in one_off}
    combinations = {
        row["participant"]: tuple(row.get(column) for column in columns)
        for row in tables["participants"][1]
        if row["participant"] in answered
    }
    counts = Counter(combinations.values())
    return columns, [name for name, combination in combinations.items() if counts[combination] == 1]


def _check_columns(without: Iterable[str], answers: Iterable[Mapping[str, Any]]) -> None:
    columns = {column_of(row) for row in answers if row["position"] is None}
    for name in without:
        if name not in columns:
            raise BadInput(f"--without: {unknown_name('column of participants', name, columns)}")


def _allowed(answers: Iterable[Mapping[str, Any]], items: Mapping[tuple[str, str], Item]) -> set[Shared]:
    """Return what a participant allows in every answer that asks for it."""
    asked: dict[Shared, list[bool]] = {}
    for row in answers:
        shares = items[row["questionnaire"], row["item"]].shares
        for each in {kind for kinds in shares.values() for kind in kinds}:
            asked.setdefault(each, []).append(each in shares.get(row["answer"], ()))
    return {kind for kind, given in asked.items() if all(given)}


def _is_published(
    row: Mapping[str, Any],
    items: Mapping[tuple[str, str], Item],
    allowed: Mapping[str, set[Shared]],
    without: Collection[str],
    left_out: Counter[str],
) -> bool:
    """Decide on an answer; count it if it is left out."""
    item = items[row["questionnaire"], row["item"]]
    if row["position"] is None and column_of(row) in without:
        left_out[f"answers to {column_of(row)}"] += 1
        return False
    if item.kind == "text" and "free_text" not in allowed[row["participant"]]:
        left_out["answers in a participant's own words"] += 1
        return False
    return True


def _published_row(
    table: str,
    row: Mapping[str, Any],
    person: Mapping[str, Any],
    names: Mapping[str, str],
    hidden: Collection[tuple[str, str]],
    left_out: Counter[str],
) -> dict[str, Any]:
    published = dict(row, participant=names[row["participant"]])
    for field in COLUMNS[table]:
        if field.unit == "ISO 8601" and row.get(field.name):
            published[field.name] = shifted(row[field.name], person)
    if table == "participants":
        published |= {column: None for name, column in hidden if name == row["participant"]}
    if table == "trials":
        published |= {"recording": None, "recording_sha256": None}
        if row["void"] and row["void"] not in OWN_REASONS:
            published["void"] = REASON
            left_out["reasons in the experimenter's words"] += 1
    left_out["notes of the experimenter"] += table == "events"
    return published


def _is_column(table: str, field: Field, rows: Iterable[Mapping[str, Any]]) -> bool:
    """Decide on a column; those of demographics need a value."""
    if field.name not in [each.name for each in COLUMNS[table]] and table == "participants":
        return any(row.get(field.name) is not None for row in rows)
    is_time = field.unit == "ISO 8601"
    is_safe = field.kind != "text" or is_time or field.name in PUBLISHED | HANDLED
    return is_safe and field.name not in IDENTIFYING


def _redated(field: Field) -> Field:
    return field._replace(meaning=field.meaning + ORIGIN_NOTE) if field.unit == "ISO 8601" else field
