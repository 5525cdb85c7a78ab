"""Rerun's own library opens the export for Foxglove; every field and image is that of the recording."""

import hashlib
import json
import math

import pytest

from haptigraph.analysis.exporting.columns import RunTable
from haptigraph.analysis.exporting.runs import export_runs

pytest.importorskip("mcap_protobuf")
pytestmark = [pytest.mark.slow, pytest.mark.timeout(600)]


@pytest.fixture(scope="module")
def found(read_in, recordings, tmp_path_factory):
    """What Rerun decodes of each recording, with its table."""
    folder = tmp_path_factory.mktemp("rerun")
    export_runs(recordings, "foxglove", folder / "exported")
    decoded = []
    for path in recordings:
        output = folder / f"{path.stem}.json"
        read_in("rerun-3.11", "read_rerun.py", folder / "exported" / path.name, output)
        decoded.append((json.loads(output.read_text()), RunTable(path, path.stem)))
    return decoded


def test_every_field_of_every_step_is_that_of_the_recording(found):
    for decoded, table in found:
        rows = list(table.rows())
        assert len(decoded["steps"]) == len(rows) > 50
        for (time_ns, step), row in zip(decoded["steps"], rows, strict=True):
            assert time_ns == row.step.stamp_ns + table.reader.info.utc_offset_ns
            for column in table.columns:
                if column.name == "utc":
                    continue
                value, shown = column.value(row), step[column.name]
                if value is None and column.kind == "number":
                    assert math.isnan(shown), column.name
                else:
                    assert (shown or None if column.kind == "texts" else shown) == (
                        value or None if column.kind == "texts" else value
                    ), column.name


def test_every_image_is_that_of_the_recording(found):
    media_types = set()
    for decoded, table in found:
        captures = [row.capture for row in table.rows(images=True) if row.capture.image is not None]
        expected = [hashlib.sha256(capture.encoded).hexdigest() for capture in captures]
        assert [digest for _, _, digest in decoded["images"]] == expected
        media_types |= {media_type for _, media_type, _ in decoded["images"]}
    assert media_types == {"image/jpeg", "image/png"}
