"""The results of a sweep, kept one by one as they come, so that nothing is computed twice.

Turns rows of trials into one SQLite file and back. Knows not how they are made.
"""

import json
import sqlite3
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from haptigraph.errors import BadInput

__all__ = ["SweepResults"]

MADE = """
CREATE TABLE IF NOT EXISTS about (name TEXT PRIMARY KEY, value TEXT NOT NULL);
CREATE TABLE IF NOT EXISTS results (
    variation TEXT, participant INTEGER, trials TEXT NOT NULL, PRIMARY KEY (variation, participant)
);
"""


class SweepResults:
    """Results by variation and participant; each is on the disk when `keep` returns.

    Args:
        path: The file; made if it is not there.
        about: What all results depend on, by name.

    Raises:
        BadInput: If it is no such file, or its results depend on something else.
    """

    def __init__(self, path: Path, about: Mapping[str, str]) -> None:
        self._file = sqlite3.connect(path, timeout=30)
        try:
            self._file.executescript(MADE)
            with self._file:
                self._file.executemany("INSERT OR IGNORE INTO about VALUES (?, ?)", about.items())
            before = dict(self._file.execute("SELECT name, value FROM about"))
        except sqlite3.DatabaseError as error:
            self.close()
            raise BadInput(f"holds no results of a sweep ({error})", path) from None
        for name, value in about.items():
            if before[name] != value:
                self.close()
                told = f"{name} was {before[name]}, is {value} now"
                raise BadInput(f"was begun otherwise: {told}; go on as it was begun, or elsewhere", path)

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    def there(self) -> set[tuple[str, int]]:
        """Return which results there are."""
        return set(self._file.execute("SELECT variation, participant FROM results"))

    def keep(self, variation: str, participant: int, trials: Sequence[Mapping[str, Any]]) -> None:
        """Keep the trials of one participant."""
        with self._file:
            row = (variation, participant, json.dumps(trials))
            self._file.execute("INSERT OR REPLACE INTO results VALUES (?, ?, ?)", row)

    def trials(self, variation: str, participants: int) -> Iterator[dict[str, Any]]:
        """Yield the trials of the first so many participants of a variation."""
        asked = "SELECT trials FROM results WHERE variation = ? AND participant < ? ORDER BY participant"
        for (trials,) in self._file.execute(asked, (variation, participants)):
            yield from json.loads(trials)
