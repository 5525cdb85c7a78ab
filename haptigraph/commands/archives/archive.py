"""Commands for many recordings: archive, query."""

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from haptigraph.commands.help import examples
from haptigraph.commands.spreading import cluster_of, cluster_options, usable_cores, workers_option
from haptigraph.commands.terminal import print_status, progress_bar, terminable

if TYPE_CHECKING:
    from haptigraph.analysis.archive.query import Answer

__all__ = ["archive", "query"]

MAX_DAMAGED = 10
MAX_WIDTH = 240  # of a table, in characters


@click.command(epilog=examples("haptigraph archive recordings", "haptigraph archive recordings --workers 4"))
@click.argument("folder")
@workers_option
@cluster_options
def archive(folder: str, workers: int | None, cluster: str | None, tls: str | None) -> None:
    """Index all recordings below FOLDER, for `haptigraph query` and the recordings page.

    FOLDER/archive receives runs.parquet, a row for each recording, and the steps of all. Only what is new or
    has changed is read; what is gone is erased from the index. A recording that cannot be read is listed with
    the reason. After an interruption, run it again to resume. An index of another version is made
    again. Needs haptigraph[archive].
    """
    from haptigraph.analysis.archive.index import update_archive

    with terminable(), progress_bar() as progress:
        updated = update_archive(
            Path(folder),
            workers=workers or usable_cores(),
            cluster=cluster_of(cluster, tls),
            progress=progress,
        )
    if updated.is_made_again:
        click.echo("the index was of another version of haptigraph, and is made again")
    click.echo(
        f"{updated.indexed} recordings indexed, {updated.unchanged} unchanged, {updated.removed} removed"
    )
    if updated.being_written:
        click.echo(f"{updated.being_written} are still being recorded, and not indexed")
    for name, problem in updated.damaged[:MAX_DAMAGED]:
        click.echo(f"cannot be read: {name}: {problem}")
    if len(updated.damaged) > MAX_DAMAGED:
        click.echo(
            f"and {len(updated.damaged) - MAX_DAMAGED} more: select recording, problem from runs "
            "where problem != ''"
        )


@click.command(
    epilog=examples(
        'haptigraph query "select recording, outcome, completion_s from runs order by started_utc"',
        'haptigraph query "from columns"',
        'haptigraph query --archive recordings "select distinct recording from steps where theta_deg > 5"',
    )
)
@click.argument("sql")
@click.option(
    "--archive",
    "folder",
    metavar="FOLDER",
    default=".",
    help="The folder of recordings that `haptigraph archive` indexed; default: the current one.",
)
@click.option(
    "--csv", "as_csv", is_flag=True, help="Print CSV; a map such as state_s has a column for each key."
)
def query(sql: str, folder: str, as_csv: bool) -> None:
    """Run one SELECT statement of DuckDB over an archive.

    The tables are runs, a row for each recording; steps, a row for each step; and columns, the unit and
    meaning of every column. A query changes nothing, and reaches no file and no network. Needs
    haptigraph[archive].
    """
    from haptigraph.analysis.archive.query import query_archive, staleness

    answer = query_archive(Path(folder), sql)
    if note := staleness(Path(folder)):
        print_status(f"haptigraph: {note}")
    if as_csv:
        import csv

        csv.writer(sys.stdout, lineterminator="\n").writerows(_flat(answer))
        return
    lines = _aligned(answer)
    for line in lines if max(map(len, lines)) <= MAX_WIDTH else _listed(answer):
        click.echo(line)
    click.echo(f"({len(answer.rows)} rows)")


def _aligned(answer: "Answer") -> list[str]:
    """Return a table as lines, numbers to the right."""
    cells = [answer.columns, *([_text(value) for value in row] for row in answer.rows)]
    widths = [max(map(len, column)) for column in zip(*cells, strict=True)]
    are_numbers = [
        all(isinstance(value, int | float | None) for value in column)
        for column in zip(*answer.rows, strict=True)
    ] or [False] * len(widths)
    lines = [
        "  ".join(
            cell.rjust(width) if is_number else cell.ljust(width)
            for cell, width, is_number in zip(row, widths, are_numbers, strict=True)
        ).rstrip()
        for row in cells
    ]
    return [lines[0], "-" * max(map(len, lines)), *lines[1:]]


def _listed(answer: "Answer") -> list[str]:
    """Return rows that are too wide for a table: a line for each value, an empty one after each row."""
    width = max(map(len, answer.columns))
    return [
        line
        for row in answer.rows
        for line in (
            *(f"{name:{width}}  {_text(value)}" for name, value in zip(answer.columns, row, strict=True)),
            "",
        )
    ]


def _flat(answer: "Answer") -> list[list[Any]]:
    """Return header and rows with a column for each key of a map: state_s.retinal_contact."""
    columns: list[list[Any]] = []
    for name, values in zip(answer.columns, zip(*answer.rows, strict=True), strict=False):
        keys = dict.fromkeys(key for value in values if isinstance(value, dict) for key in value)
        columns += [[f"{name}.{key}", *((value or {}).get(key) for value in values)] for key in keys]
        columns += [] if keys else [[name, *values]]
    return [list(row) for row in zip(*columns, strict=True)] if answer.rows else [answer.columns]


def _text(value: Any) -> str:
    if value is None:
        return "-"
    if isinstance(value, dict):
        return ", ".join(f"{key} {_text(each)}" for key, each in value.items()) or "-"
    return f"{value:.6g}" if isinstance(value, float) else " ".join(str(value).split())
