"""Export a recorded run as a CSV table: one row a step; and the data dictionary of any export."""

import csv
from collections.abc import Iterable
from datetime import datetime
from pathlib import Path
from typing import Any

from haptigraph.analysis.exporting.columns import RunTable
from haptigraph.errors import BadInput
from haptigraph.recording.writer import Progress

__all__ = ["run_csv", "write_dictionary"]

DICTIONARY = ("column", "kind", "unit", "meaning")


def run_csv(
    path: str | Path, output: str | Path, progress: Progress | None = None, name: str | None = None
) -> None:
    """Write one recorded run as CSV; `columns` defines the columns.

    Args:
        path: The recording.
        output: The file to write; replaced if it exists.
        progress: Called with the number of steps written.
        name: What the column `recording` says; None: the file's name.

    Raises:
        BadInput: If the recording cannot be read or the file cannot be written.
    """
    table = RunTable(path, name or Path(path).stem)
    try:
        with open(output, "w", newline="", encoding="utf-8") as file:
            writer = csv.writer(file)
            writer.writerow(column.name for column in table.columns)
            for count, row in enumerate(table.rows(), 1):
                writer.writerow(_cell(column.value(row)) for column in table.columns)
                if progress is not None:
                    progress("writing", count, 0)
    except OSError as error:  # that of a full disk does not name the file
        raise BadInput(f"cannot be written ({error.strerror})", output) from None


def write_dictionary(path: Path, columns: Iterable[tuple[str, str, str, str]]) -> None:
    """Write a data dictionary: name, kind, unit and meaning of every column or part.

    Args:
        path: The CSV file to write.
        columns: These four texts of each.

    Raises:
        OSError: If it cannot be written.
    """
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(DICTIONARY)
        writer.writerows(columns)


def _cell(value: Any) -> Any:
    """Return a value as the table shows it; None becomes an empty field."""
    if isinstance(value, datetime):
        return value.isoformat(timespec="microseconds")
    return "; ".join(value) if isinstance(value, list) else value
