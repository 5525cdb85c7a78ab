"""Write the tables of an export as Parquet."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from haptigraph.errors import MissingExtra
from haptigraph.study.data_dictionary import Field
from haptigraph.study.exchange.exporting import WriteTable

__all__ = ["parquet_writer"]


def parquet_writer() -> WriteTable:
    """Return a writer of Parquet tables; their column metadata holds unit and meaning.

    Raises:
        MissingExtra: If pyarrow is not installed.
    """
    try:
        import pyarrow as pa  # noqa: PLC0415
        from pyarrow import parquet  # noqa: PLC0415
    except ModuleNotFoundError:
        raise MissingExtra("an export as Parquet", "parquet") from None
    types = {"text": pa.string(), "integer": pa.int64(), "number": pa.float64()}

    def write(path: Path, fields: Sequence[Field], rows: Sequence[Mapping[str, Any]]) -> None:
        columns = [
            pa.field(field.name, types[field.kind], metadata={"unit": field.unit, "meaning": field.meaning})
            for field in fields
        ]
        table = [{field.name: row.get(field.name) for field in fields} for row in rows]
        parquet.write_table(pa.Table.from_pylist(table, pa.schema(columns)), path)

    return write
