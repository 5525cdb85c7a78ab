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
from haptigraph.study.exchange.exporting import ITEMS, Tables, column_of
from haptigraph.study.questionnaire import Questionnaire, Shared
from haptigraph.study.sharing.rekeying import ORIGIN, shifted, without_contacts

__all__ = ["HANDLED", "PUBLISHED", "Redacted", "redacted", "unique_people"]

PUBLISHED = {
    *("study", "condition", "phase", "target", "outcome", "state_order", "procedure_sha256", "software"),
    *("questionnaire", "item", "order", "stage", "kind", "attempt_reason", "touch", "task", "pattern"),
    *("response", "device", "page_output", "touch_output"),
}
"""Columns of text that name nobody: names from the protocol, of hardware, and the program's own words."""
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
    return _Redaction(tables, questionnaires, names, without).result()


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


class _Redaction:
    """One call of `redacted`, which counts what it leaves out."""

    def __init__(
        self,
        tables: Tables,
        questionnaires: Collection[Questionnaire],
        names: Mapping[str, str],
        without: Collection[str],
    ) -> None:
        self._tables, self._names, self._without = tables, names, without
        self._people = {row["participant"]: row for row in tables["participants"][1]}
        self._present = {
            name for name, row in self._people.items() if row["consented_utc"] and not row["withdrawn_utc"]
        }
        self._items = {(each.name, item.key): item for each in questionnaires for item in each.items}
        self._hidden = set[tuple[str, str]]()  # participants and their columns
        self._left_out = Counter[str]()
        answers = tables["answers"][1]
        columns = {column_of(row) for row in answers if row["position"] is None}
        for name in without:
            if name not in columns:
                raise BadInput(f"--without: {unknown_name('column of participants', name, columns)}")
        self._allowed = {
            name: self._allowed_in([row for row in answers if row["participant"] == name])
            for name in self._present
        }

    def result(self) -> Redacted:
        of_people = [name for name in self._tables if name != ITEMS]
        answers_first = sorted(of_people, key=lambda name: name != "answers")  # participants repeat them
        published = {table: self._table(table) for table in answers_first}
        recorded = [
            row
            for row in self._tables["trials"][1]
            if row["recording_sha256"] and row["participant"] in self._present
        ]
        shared = [row for row in recorded if "recordings" in self._allowed[row["participant"]]]
        absent = len(self._people) - len(self._present)
        asks = any("recordings" in each for item in self._items.values() for each in item.shares.values())
        why = (
            "not allowed by their participants" if asks else "the protocol does not ask for consent to share"
        )
        self._left_out[f"recordings ({why})"] = len(recorded) - len(shared)
        self._left_out["participants who withdrew, or did not consent, with all their rows"] = absent
        left_out = {what: count for what, count in self._left_out.items() if count}
        if ITEMS in self._tables:
            fields, items = self._tables[ITEMS]
            published[ITEMS] = fields, [_without_contacts(row) for row in items]
        ordered = {name: published[name] for name in self._tables}
        return Redacted(ordered, shared, sorted(self._present), left_out)

    def _table(self, table: str) -> tuple[list[Field], list[dict[str, Any]]]:
        fields, rows = self._tables[table]
        kept = [self._row(table, row) for row in rows if self._is_kept(table, row)]
        columns = [_redated(field) for field in fields if _is_column(table, field, kept)]
        return columns, sorted(kept, key=lambda row: row["participant"])

    def _is_kept(self, table: str, row: Mapping[str, Any]) -> bool:
        is_present = table == "participants" or row["participant"] in self._present
        if table != "answers":
            return is_present
        is_kept = is_present and self._is_published(row)
        if not is_kept and row["position"] is None:
            self._hidden.add((row["participant"], column_of(row)))
        return is_kept

    def _is_published(self, answer: Mapping[str, Any]) -> bool:
        if answer["position"] is None and column_of(answer) in self._without:
            self._left_out[f"answers to {column_of(answer)}"] += 1
            return False
        is_free = self._items[answer["questionnaire"], answer["item"]].kind == "text"
        if is_free and "free_text" not in self._allowed[answer["participant"]]:
            self._left_out["answers in a participant's own words"] += 1
            return False
        return True

    def _allowed_in(self, answers: Iterable[Mapping[str, Any]]) -> set[Shared]:
        """Return what every answer that asks for it allows."""
        asked: dict[Shared, list[bool]] = {}
        for row in answers:
            shares = self._items[row["questionnaire"], row["item"]].shares
            for each in {kind for kinds in shares.values() for kind in kinds}:
                asked.setdefault(each, []).append(each in shares.get(row["answer"], ()))
        return {kind for kind, given in asked.items() if all(given)}

    def _row(self, table: str, row: Mapping[str, Any]) -> dict[str, Any]:
        name = row["participant"]
        published = dict(row, participant=self._names[name])
        for field in COLUMNS[table]:
            if field.unit == "ISO 8601" and row.get(field.name):
                published[field.name] = shifted(row[field.name], self._people[name])
        if table == "participants":
            published |= {column: None for hidden, column in self._hidden if hidden == name}
        if table == "trials":
            published |= {"recording": None, "recording_sha256": None}
            if row["void"] and row["void"] not in OWN_REASONS:
                published["void"] = REASON
                self._left_out["reasons in the experimenter's words"] += 1
        if table == "events":
            self._left_out["notes of the experimenter"] += 1
        return published


def _without_contacts(row: Mapping[str, Any]) -> dict[str, Any]:
    return {
        name: without_contacts(value)[0] if isinstance(value, str) else value for name, value in row.items()
    }


def _is_column(table: str, field: Field, rows: Iterable[Mapping[str, Any]]) -> bool:
    """Decide on a column; those of demographics need a value."""
    if field.name not in [each.name for each in COLUMNS[table]] and table == "participants":
        return any(row.get(field.name) is not None for row in rows)
    is_time = field.unit == "ISO 8601"
    is_safe = field.kind != "text" or is_time or field.name in PUBLISHED | HANDLED
    return is_safe and field.name not in IDENTIFYING


def _redated(field: Field) -> Field:
    return field._replace(meaning=field.meaning + ORIGIN_NOTE) if field.unit == "ISO 8601" else field
