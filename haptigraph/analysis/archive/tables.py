"""The Parquet files of an archive: runs.parquet, a row for each recording, and parts with the steps of many.

A part is complete before runs.parquet names it, and a part that runs.parquet does not name does not count: so
a killed update leaves an archive as it was, or with some recordings more.
"""

import os
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from haptigraph.analysis.archive.dictionary import RUNS, STEPS, Kind
from haptigraph.errors import BadInput, MissingExtra

try:
    import pyarrow as pa
    import pyarrow.compute as pc
    from pyarrow import dataset, parquet
except ModuleNotFoundError:
    raise MissingExtra("an archive", "archive") from None

__all__ = ["Archive", "no_runs", "steps_table", "with_rows"]

FOLDER, RUNS_FILE = "archive", "runs.parquet"
FORMAT = b"3"
FORMAT_KEY = b"haptigraph.archive"
TYPES: dict[Kind, Any] = {
    "text": pa.string(),
    "integer": pa.int64(),
    "number": pa.float64(),
    "yes_no": pa.bool_(),
    "time": pa.timestamp("us"),
    "numbers": pa.map_(pa.string(), pa.float64()),
    "integers": pa.map_(pa.string(), pa.int64()),
}
RUNS_SCHEMA = pa.schema([(column.name, TYPES[column.kind]) for column in RUNS], metadata={FORMAT_KEY: FORMAT})
STEPS_TYPES = {column.name: TYPES[column.kind] for column in STEPS}


def no_runs() -> pa.Table:
    """Return the table of recordings of an archive without any."""
    return RUNS_SCHEMA.empty_table()


def with_rows(runs: pa.Table, rows: Sequence[Mapping[str, Any]]) -> pa.Table:
    """Append recordings to their table; what a row leaves out is empty, its problem the empty text."""
    added = pa.Table.from_pylist([{"problem": "", **_typed(row)} for row in rows], RUNS_SCHEMA)
    return pa.concat_tables([runs, added])


def steps_table(name: str, columns: Mapping[str, list[Any]]) -> pa.Table:
    """Return the steps of one recording as a table."""
    arrays = {key: pa.array(values, STEPS_TYPES.get(key, pa.float64())) for key, values in columns.items()}
    return pa.table({"recording": pa.array([name] * len(columns["step"]), pa.string()), **arrays})


class Archive:
    """The files of the archive of a folder.

    Args:
        folder: Of the recordings; the archive is its subfolder `archive`.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.place = folder / FOLDER

    @property
    def exists(self) -> bool:
        """Whether there is an index."""
        return (self.place / RUNS_FILE).is_file()

    def runs(self) -> pa.Table | None:
        """Return the table of recordings; None if there is none, or another version wrote it.

        Raises:
            BadInput: If it cannot be read.
        """
        if not self.exists:
            return None
        try:
            table = parquet.read_table(self.place / RUNS_FILE)
        except (pa.ArrowException, OSError) as error:
            problem = f"cannot be read ({error}); delete it, and `haptigraph archive` makes it again"
            raise BadInput(problem, self.place / RUNS_FILE) from None
        is_current = (table.schema.metadata or {}).get(FORMAT_KEY) == FORMAT
        return table.cast(RUNS_SCHEMA) if is_current else None

    def steps(self, runs: pa.Table) -> dataset.Dataset:
        """Return the steps of recordings, with the columns of all procedures."""
        parts = sorted(set(runs["part"].drop_null().to_pylist()))
        files = [self.place / name for name in parts]
        schema = pa.schema(list(STEPS_TYPES.items()))
        schemas = [schema, *(parquet.read_schema(file) for file in files)]
        return dataset.dataset([str(file) for file in files], pa.unify_schemas(schemas), format="parquet")

    def write_runs(self, table: pa.Table) -> None:
        """Replace the table of recordings, and remove the parts that it does not name."""
        self._write(table, RUNS_FILE)
        named = set(table["part"].drop_null().to_pylist())
        for file in self.place.glob("steps-*.parquet"):
            if file.name not in named:
                file.unlink()

    def write_part(self, tables: Sequence[pa.Table]) -> str:
        """Write a new part; return its name."""
        numbers = [int(file.stem.removeprefix("steps-")) for file in self.place.glob("steps-*.parquet")]
        name = f"steps-{max(numbers, default=0) + 1:06}.parquet"
        self._write(pa.concat_tables(tables, promote_options="default"), name)
        return name

    def without(self, runs: pa.Table, names: Sequence[str]) -> pa.Table:
        """Return the rows of all recordings but some, and write their parts again without those."""
        is_gone = pc.is_in(runs["recording"], pa.array(names, pa.string()))
        kept, parts = runs.filter(pc.invert(is_gone)), runs.filter(is_gone)["part"].drop_null().to_pylist()
        replaced = {}
        for part in sorted(set(parts)):
            table = parquet.read_table(self.place / part)
            rest = table.filter(pc.invert(pc.is_in(table["recording"], pa.array(names, pa.string()))))
            replaced[part] = self.write_part([rest]) if rest.num_rows else None
        column = pa.array([replaced.get(part, part) for part in kept["part"].to_pylist()], pa.string())
        return kept.set_column(kept.schema.get_field_index("part"), "part", column)

    def _write(self, table: pa.Table, name: str) -> None:
        temporary = self.place / f".{name}.new"
        try:
            parquet.write_table(table, temporary, compression="zstd")
            os.replace(temporary, self.place / name)
        except OSError as error:
            raise BadInput(f"cannot be written ({error.strerror or error})", self.place / name) from None
        finally:
            temporary.unlink(missing_ok=True)


def _typed(row: Mapping[str, Any]) -> dict[str, Any]:
    typed = dict(row)
    for name in typed.keys() & {"faults", "run_state_s", "state_s"}:
        typed[name] = list(typed[name].items())
    if "started_utc" in typed:
        started = datetime.fromisoformat(typed["started_utc"])
        typed["started_utc"] = started.astimezone(UTC).replace(tzinfo=None)
    return typed
