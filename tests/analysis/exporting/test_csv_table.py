import csv

import pytest

from haptigraph import assemble
from haptigraph.analysis.exporting.csv_table import run_csv
from haptigraph.config import load_config
from haptigraph.errors import BadInput
from haptigraph.recording.reader import RunReader


@pytest.fixture(scope="module")
def recording(sparse_uri, tmp_path_factory):
    path = tmp_path_factory.mktemp("export") / "r.mcap"
    settings = (f"source.uri={sparse_uri}", "run.realtime=false", f'recording.path="{path}"')
    assemble.build(load_config(None, settings)).run()
    return path


def test_a_table_has_a_row_per_step_and_empty_cells_for_missing_values(recording, tmp_path):
    run_csv(recording, tmp_path / "run.csv")
    with (tmp_path / "run.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    steps = [step for _, step in RunReader(recording).records(images=())]
    assert [int(row["step"]) for row in rows] == list(range(len(steps)))
    for row, step in zip(rows, steps, strict=True):
        tip = step.observation.found.get("needle_tip")
        assert (row["needle_tip_x_mm"], row["needle_tip_y_mm"]) == (
            tuple(map(str, tip.at_mm)) if tip else ("", "")
        )
        assert bool(row["theta_deg"]) == ("theta_deg" in step.graph.measures)
    assert rows[-1]["faults"] == ""
    assert {len(row["utc"]) for row in rows} == {len("2026-07-01T09:00:00.000000+00:00")}
    assert {row["theta_deg"] == "" for row in rows} == {True, False}


def test_a_missing_folder_is_refused(recording, tmp_path):
    with pytest.raises(BadInput, match="cannot be written"):
        run_csv(recording, tmp_path / "none" / "run.csv")
