"""Query an archive with SQL: DuckDB over the tables `runs`, `steps` and `columns`.

The database is in memory, has the archive's tables only, and reaches neither files nor the network
(`enable_external_access = false`); one statement that selects is accepted.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

from haptigraph.analysis.archive.dictionary import RUNS, columns_of_steps
from haptigraph.analysis.archive.index import changes_in
from haptigraph.errors import BadInput, MissingExtra

try:
    import duckdb
    import pyarrow as pa

    from haptigraph.analysis.archive.tables import Archive
except ModuleNotFoundError:
    raise MissingExtra("a query", "archive") from None

__all__ = ["Answer", "open_archive", "query_archive", "staleness"]

CONFIG: dict[str, str | bool | int | float | list[str]] = {
    "enable_external_access": False,
    "autoinstall_known_extensions": False,
    "autoload_known_extensions": False,
    "python_enable_replacements": False,  # otherwise a query could name a variable of this program
}


class Answer(NamedTuple):
    """Rows that a query selected."""

    columns: list[str]
    rows: list[tuple[Any, ...]]
    is_complete: bool = True
    """False if there are more rows than were asked for."""


def query_archive(
    folder: Path, sql: str, parameters: Sequence[Any] = (), max_rows: int | None = None
) -> Answer:
    """Run one SELECT over the archive of a folder.

    Args:
        folder: The folder of recordings.
        sql: The statement.
        parameters: Values of its question marks.
        max_rows: Number of rows to return; None: all.

    Raises:
        BadInput: If there is no archive, or the statement is refused.
    """
    with open_archive(folder) as connection:
        try:
            statements = connection.extract_statements(sql)
            if len(statements) != 1 or statements[0].type != duckdb.StatementType.SELECT:
                raise BadInput("a query is one SELECT statement", "query")
            found = connection.execute(statements[0], list(parameters))
            columns = [column[0] for column in found.description or ()]
            rows = found.fetchall() if max_rows is None else found.fetchmany(max_rows + 1)
        except duckdb.Error as error:
            raise BadInput(" ".join(str(error).split()), "query") from None
    return Answer(columns, rows[:max_rows], max_rows is None or len(rows) <= max_rows)


def open_archive(folder: Path) -> duckdb.DuckDBPyConnection:
    """Return a database with the tables of an archive and nothing else.

    Raises:
        BadInput: If there is no archive.
    """
    archive = Archive(folder)
    if not archive.exists:
        raise BadInput(f"has no archive; create one with `haptigraph archive {folder}`", folder)
    runs = archive.runs()
    if runs is None:
        update = f"bring it up to date with `haptigraph archive {folder}`"
        raise BadInput(f"its archive is of another version of haptigraph; {update}", folder)
    connection = duckdb.connect(":memory:", config=CONFIG)
    steps = archive.steps(runs)
    connection.register("runs", runs)
    connection.register("steps", steps)
    connection.register("columns", _columns(steps.schema.names))
    connection.execute("SET lock_configuration = true")
    return connection


def staleness(folder: Path) -> str:
    """Return a sentence about recordings that the index does not know as they are; empty: none."""
    changes = changes_in(folder, Archive(folder).runs())
    read = {task.name for task in changes.to_read}
    counts = {"new or changed": len(read), "gone": sum(name not in read for name in changes.gone)}
    found = [f"{count} recordings are {what}" for what, count in counts.items() if count]
    if not found:
        return ""
    return f"{' and '.join(found)} since the index was made; update it with `haptigraph archive {folder}`"


def _columns(steps: Sequence[str]) -> pa.Table:
    """Return the data dictionary."""
    tables = {"runs": RUNS, "steps": columns_of_steps(steps)}
    listed = [(table, *column) for table, columns in tables.items() for column in columns]
    names = ("table_name", "name", "kind", "meaning", "unit")
    return pa.Table.from_pylist([dict(zip(names, row, strict=True)) for row in listed])
