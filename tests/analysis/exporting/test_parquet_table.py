import sys

import pytest

from haptigraph.analysis.exporting import parquet_table
from haptigraph.analysis.exporting.columns import RunTable
from haptigraph.analysis.exporting.parquet_table import run_parquet
from haptigraph.errors import MissingExtra

parquet = pytest.importorskip("pyarrow.parquet")


def test_every_value_is_that_of_the_column(recording, tmp_path, monkeypatch):
    monkeypatch.setattr(parquet_table, "STEPS_PER_GROUP", 50)  # several groups
    reported = []
    run_parquet(recording, tmp_path / "run.parquet", lambda what, done, total: reported.append(done), "run")
    found = parquet.read_table(tmp_path / "run.parquet")
    table = RunTable(recording, "run")
    rows = list(table.rows())
    assert reported[-1] == len(rows)
    assert parquet.ParquetFile(tmp_path / "run.parquet").num_row_groups == -(-len(rows) // 50)
    assert found.column_names == [column.name for column in table.columns]
    for column in table.columns:
        assert found.column(column.name).to_pylist() == [column.value(row) for row in rows], column.name


def test_units_meanings_and_the_header_are_in_the_file(recording, tmp_path):
    run_parquet(recording, tmp_path / "run.parquet", None, "run")
    table = RunTable(recording, "run")
    schema = parquet.read_schema(tmp_path / "run.parquet")
    for column in table.columns:
        metadata = schema.field(column.name).metadata
        assert (metadata[b"unit"].decode(), metadata[b"meaning"].decode()) == (column.unit, column.meaning)
    assert schema.metadata[b"haptigraph.procedure"].decode() == table.reader.info.procedure
    assert str(schema.field("utc").type) == "timestamp[us, tz=UTC]"


def test_without_pyarrow_the_extra_is_named(recording, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    with pytest.raises(MissingExtra, match=r"haptigraph\[parquet\]"):
        run_parquet(recording, tmp_path / "run.parquet", None, "run")
    assert not (tmp_path / "run.parquet").exists()
