"""The results of a batch in one SQLite file, stored recording by recording, so that it can be resumed."""

import sqlite3
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import msgspec

from haptigraph.analysis.batch.tasks import BatchTask, Done
from haptigraph.errors import BadInput

__all__ = ["BatchResults", "Row"]

SCHEMA = """
CREATE TABLE IF NOT EXISTS about (name TEXT PRIMARY KEY, value TEXT NOT NULL);
CREATE TABLE IF NOT EXISTS results (
    recording TEXT PRIMARY KEY, size INTEGER, changed_ns INTEGER, problem TEXT NOT NULL, result TEXT NOT NULL,
    cpu_s REAL NOT NULL
);
"""


class Row(NamedTuple):
    """The result of one recording."""

    recording: str
    problem: str
    result: dict[str, Any]
    cpu_s: float


class BatchResults:
    """Results by recording, which are durable when `add` returns.

    Args:
        path: The file; created if it does not exist.
        about: What all results depend on, by name.

    Raises:
        BadInput: If it is not such a file, or its results depend on something else.
    """

    def __init__(self, path: Path, about: Mapping[str, str]) -> None:
        self._file = sqlite3.connect(path, timeout=30)
        try:
            self._file.executescript(SCHEMA)
            with self._file:
                self._file.executemany("INSERT OR IGNORE INTO about VALUES (?, ?)", about.items())
            stored = dict(self._file.execute("SELECT name, value FROM about"))
        except sqlite3.DatabaseError as error:
            self.close()
            raise BadInput(f"does not contain results of a batch ({error})", path) from None
        for name, value in about.items():
            if stored[name] != value:
                self.close()
                change = f"{name} was {stored[name] or 'not given'}, is {value or 'not given'} now"
                raise BadInput(f"has results of another batch: {change}; use another folder", path)

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    def stored(self) -> dict[str, tuple[int, int]]:
        """Return size and time of change of every recording that has a result."""
        found = self._file.execute("SELECT recording, size, changed_ns FROM results")
        return {name: (size, changed_ns) for name, size, changed_ns in found}

    def add(self, task: BatchTask, done: Done) -> None:
        """Store a result; an earlier one of the same recording is replaced."""
        result = msgspec.json.encode(done.result).decode()
        row = (task.name, task.size, task.changed_ns, done.problem, result, done.cpu_s)
        with self._file:
            self._file.execute("INSERT OR REPLACE INTO results VALUES (?, ?, ?, ?, ?, ?)", row)

    def remove(self, names: list[str]) -> None:
        """Remove the results of recordings that are gone."""
        with self._file:
            self._file.executemany("DELETE FROM results WHERE recording = ?", [(name,) for name in names])

    def rows(self) -> Iterator[Row]:
        """Yield all results, in the order of the recordings' names."""
        query = "SELECT recording, problem, result, cpu_s FROM results ORDER BY recording"
        for name, problem, result, cpu_s in self._file.execute(query):
            yield Row(name, problem, msgspec.json.decode(result), cpu_s)
