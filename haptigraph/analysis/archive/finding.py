"""Find recordings by a form: its fields become a query whose every value is bound, never part of the text."""

from pathlib import Path
from typing import Any, Literal

from msgspec import Struct

from haptigraph.analysis.archive.dictionary import measures_among
from haptigraph.analysis.archive.query import Answer, query_archive
from haptigraph.errors import BadInput, unknown_name

__all__ = ["Condition", "Filter", "find", "measures_of"]

MAX_FOUND = 500
SHOWN = (
    "recording",
    "started_utc",
    "length_s",
    "procedure",
    "participant",
    "trial",
    "outcome",
    "alarms",
    "problem",
)


class Condition(Struct, frozen=True):
    """A limit on a measure in one step."""

    measure: str
    way: Literal["above", "below"]
    value: float


class Filter(Struct, frozen=True):
    """The fields of the form; an empty one does not restrict."""

    since: str = ""
    """Date, ISO 8601, in UTC."""
    until: str = ""
    """Last day."""
    procedure: str = ""
    participant: str = ""
    outcome: str = ""
    state: str = ""
    """A state that occurred."""
    has_fault: bool = False
    has_alarm: bool = False
    conditions: tuple[Condition, ...] = ()
    """Limits that one step meets together."""


def find(folder: Path, given: Filter) -> Answer:
    """Return the recordings that a filter selects, newest first.

    The last column is the number of the first step that meets the conditions, or has the state; None: neither
    was given.

    Raises:
        BadInput: If there is no archive, or a field is not valid.
    """
    measures = measures_of(folder) if given.conditions else ()
    runs, run_values = _about_the_run(given)
    steps, step_values = _about_a_step(given, measures)
    first = "NULL"
    if steps:
        is_met = " AND ".join(["steps.recording = runs.recording", *steps])
        first = f"(SELECT min(step) FROM steps WHERE {is_met})"
        runs.append("first_step IS NOT NULL")
    sql = (
        f"SELECT {', '.join(SHOWN)}, first_step FROM (SELECT *, {first} AS first_step FROM runs) "
        f"WHERE {' AND '.join(['true', *runs])} ORDER BY started_utc DESC, recording"
    )
    return query_archive(folder, sql, [*step_values, *run_values], MAX_FOUND)


def measures_of(folder: Path) -> tuple[str, ...]:
    """Return the names of the measures in an archive.

    Raises:
        BadInput: If there is no archive.
    """
    names = query_archive(folder, "SELECT * FROM steps LIMIT 0").columns
    return tuple(sorted(measures_among(names)))


def _about_the_run(given: Filter) -> tuple[list[str], list[Any]]:
    clauses: dict[str, Any] = {
        "started_utc >= CAST(? AS TIMESTAMP)": given.since,
        "started_utc < CAST(? AS TIMESTAMP) + INTERVAL 1 DAY": given.until,
        "procedure = ?": given.procedure,
        "participant = ?": given.participant,
        "outcome = ?": given.outcome,
    }
    used = {clause: value for clause, value in clauses.items() if value}
    wheres = list(used)
    wheres += ["faulty_steps > 0"] * given.has_fault + ["alarms > 0"] * given.has_alarm
    return wheres, list(used.values())


def _about_a_step(given: Filter, measures: tuple[str, ...]) -> tuple[list[str], list[Any]]:
    wheres, values = list[str](), list[Any]()
    if given.state:
        wheres.append("state = ?")
        values.append(given.state)
    for condition in given.conditions:
        if condition.measure not in measures:  # the one name that becomes part of the text
            raise BadInput(unknown_name("measure", condition.measure, measures), "filter")
        wheres.append(f'"{condition.measure}" {">" if condition.way == "above" else "<"} ?')
        values.append(condition.value)
    return wheres, values
