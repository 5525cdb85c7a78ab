"""A table of an export as Parquet: the same rows as in CSV, with their types. Needs the extra `parquet`."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from haptigraph.errors import MissingExtra
from haptigraph.study.data_dictionary import Field

try:
    import pyarrow
    from pyarrow import parquet
except ModuleNotFoundError:
    raise MissingExtra("an export as Parquet", "parquet") from None

__all__ = ["write_parquet"]

TYPES = {"text": pyarrow.string(), "integer": pyarrow.int64(), "number": pyarrow.float64()}


def write_parquet(path: Path, fields: Sequence[Field], rows: Sequence[Mapping[str, Any]]) -> None:
    """Write a table; what is missing in a row is null. Units and meanings stand in the columns' metadata."""
    columns = [
        pyarrow.field(field.name, TYPES[field.kind], metadata={"unit": field.unit, "meaning": field.meaning})
        for field in fields
    ]
    table = [{field.name: row.get(field.name) for field in fields} for row in rows]
    parquet.write_table(pyarrow.Table.from_pylist(table, pyarrow.schema(columns)), path)
