"""The results of a sweep in one SQLite file, stored participant by participant, so that it can be resumed."""

import json
import math
import sqlite3
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeAlias

from haptigraph.errors import BadInput
from haptigraph.study.simulated.ground_truth import OLD_NAMES
from haptigraph.study.simulated.participant import OLD_TRAITS

__all__ = ["SweepResults"]

Rows: TypeAlias = Sequence[Mapping[str, Any]]
SCHEMA = """
CREATE TABLE IF NOT EXISTS about (name TEXT PRIMARY KEY, value TEXT NOT NULL);
CREATE TABLE IF NOT EXISTS results (
    variation TEXT, participant INTEGER, trials TEXT NOT NULL, PRIMARY KEY (variation, participant)
);
"""
CHECKABLE = {"protocol_sha256", "haptigraph"}
"""What may change if stored trials are reproduced, for example by another wording of a shipped procedure."""
REPRODUCED = 2  # participants


class SweepResults:
    """Results by variation and participant, which are durable when `add` returns.

    Args:
        path: The file; created if it does not exist.
        about: What all results depend on, by name.
        simulate: Returns the trials of a variation (by its label) and participant, to check stored ones.

    Raises:
        BadInput: If it is not such a file, or its results depend on something else.
    """

    def __init__(self, path: Path, about: Mapping[str, str], simulate: Callable[[str, int], Rows]) -> None:
        self._file = sqlite3.connect(path, timeout=30)
        try:
            self._file.executescript(SCHEMA)
            with self._file:
                self._rename_old()
                self._file.executemany("INSERT OR IGNORE INTO about VALUES (?, ?)", about.items())
            stored = dict(self._file.execute("SELECT name, value FROM about"))
        except sqlite3.DatabaseError as error:
            self.close()
            raise BadInput(f"does not contain results of a sweep ({error})", path) from None
        changed = [name for name, value in about.items() if stored[name] != value]
        if changed and not (CHECKABLE.issuperset(changed) and self._reproduces(simulate)):
            self.close()
            change = f"{changed[0]} was {stored[changed[0]]}, is {about[changed[0]]} now"
            raise BadInput(f"has other settings: {change}; use the same settings, or another folder", path)
        if changed:
            problem = f"{' and '.join(changed)} changed since the sweep was started"
            text = f"{path}: {problem}; continued, as {REPRODUCED} participants give the same trials"
            warnings.warn(text, stacklevel=2)
            with self._file:
                self._file.executemany("INSERT OR REPLACE INTO about VALUES (?, ?)", about.items())

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    def stored(self) -> set[tuple[str, int]]:
        """Return variation and participant of all results."""
        return set(self._file.execute("SELECT variation, participant FROM results"))

    def add(self, variation: str, participant: int, trials: Rows) -> None:
        """Store the trials of one participant."""
        with self._file:
            row = (variation, participant, json.dumps(trials))
            self._file.execute("INSERT OR REPLACE INTO results VALUES (?, ?, ?)", row)

    def trials(self, variation: str, participants: int) -> Iterator[dict[str, Any]]:
        """Yield the trials of a variation's first participants."""
        query = "SELECT trials FROM results WHERE variation = ? AND participant < ? ORDER BY participant"
        for (trials,) in self._file.execute(query, (variation, participants)):
            yield from json.loads(trials)

    def _rename_old(self) -> None:
        """Replace names of earlier versions by today's."""
        for old, new in OLD_TRAITS.items():
            values = "variation = replace(variation, ?1, ?2), trials = replace(trials, ?1, ?2)"
            query = f"UPDATE results SET {values} WHERE instr(variation, ?1)"
            self._file.execute(query, (f"{old}=", f"{new}="))
        for old, new in OLD_NAMES.items():
            query = "UPDATE about SET value = ? WHERE name = 'perceiver' AND value = ?"
            self._file.execute(query, (new, old))

    def _reproduces(self, simulate: Callable[[str, int], Rows]) -> bool:
        query = "SELECT variation, participant, trials FROM results ORDER BY participant, variation LIMIT ?"
        stored = self._file.execute(query, (REPRODUCED,)).fetchall()
        return all(_is_same(json.loads(rows), simulate(label, number)) for label, number, rows in stored)


def _is_same(one: Rows, other: Rows) -> bool:
    """Compare trials; numbers may differ by rounding on another machine, and the version does not count."""
    if [row.keys() for row in one] != [row.keys() for row in other]:
        return False
    pairs = [(a[name], b[name]) for a, b in zip(one, other, strict=True) for name in a if name != "software"]
    return all(
        math.isclose(a, b, rel_tol=1e-6) if isinstance(a, float) and isinstance(b, float) else a == b
        for a, b in pairs
    )
