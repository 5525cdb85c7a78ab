"""Export a recorded run as a Parquet table: one row a step, with units and meanings in the file."""

from itertools import islice
from pathlib import Path

from haptigraph.analysis.exporting.columns import RunTable
from haptigraph.errors import MissingExtra
from haptigraph.recording.writer import Progress

__all__ = ["run_parquet"]

STEPS_PER_GROUP = 10_000
HEADER = (
    "version",
    "started_utc",
    "source",
    "procedure",
    "procedure_sha256",
    "registration",
    "registration_sha256",
)


def run_parquet(path: str | Path, output: str | Path, progress: Progress | None, name: str) -> None:
    """Write one recorded run as Parquet.

    Every column's metadata has its `unit` and `meaning`; the file's, the recording's header.

    Args:
        path: The recording.
        output: The file to write.
        progress: Called with the number of steps written.
        name: What the column `recording` says.

    Raises:
        BadInput: If the recording cannot be read.
        MissingExtra: If pyarrow is not installed.
    """
    try:
        import pyarrow as pa  # noqa: PLC0415 - optional
        from pyarrow import parquet  # noqa: PLC0415 - optional
    except ModuleNotFoundError:
        raise MissingExtra("an export as Parquet", "parquet") from None
    table = RunTable(path, name)
    types = {
        "text": pa.string(),
        "integer": pa.int64(),
        "number": pa.float64(),
        "texts": pa.list_(pa.string()),
    }
    fields = [
        pa.field(
            column.name,
            pa.timestamp("us", "UTC") if column.name == "utc" else types[column.kind],
            metadata={"unit": column.unit, "meaning": column.meaning},
        )
        for column in table.columns
    ]
    header = {f"haptigraph.{key}": getattr(table.reader.info, key) for key in HEADER}
    schema, rows, written = pa.schema(fields, metadata=header), table.rows(), 0
    with parquet.ParquetWriter(output, schema, compression="zstd") as writer:
        while group := list(islice(rows, STEPS_PER_GROUP)):
            arrays = [
                pa.array([column.value(row) for row in group], field.type)
                for column, field in zip(table.columns, fields, strict=True)
            ]
            writer.write_batch(pa.record_batch(arrays, schema=schema))
            written += len(group)
            if progress is not None:
                progress("writing", written, 0)
