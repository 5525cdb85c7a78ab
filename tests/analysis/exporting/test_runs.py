import csv
import json
from pathlib import Path

import pytest
from helpers import call, refuse

from haptigraph import assemble
from haptigraph.analysis.exporting import runs
from haptigraph.analysis.exporting.columns import RunTable
from haptigraph.analysis.exporting.runs import FORMATS, export_run, export_runs
from haptigraph.commands.publishing import recording as command
from haptigraph.config import load_config
from haptigraph.errors import BadInput


@pytest.fixture
def folder(recording, tmp_path):
    """Recordings of two participants, which have the same name."""
    for person in ("P01", "P02"):
        (tmp_path / "recordings" / person).mkdir(parents=True)
        (tmp_path / "recordings" / person / "trial.mcap").write_bytes(recording.read_bytes())
    return tmp_path / "recordings"


@pytest.fixture
def short(quick, tmp_path):
    """A recording of a few steps."""
    scenario, path = tmp_path / "short.toml", tmp_path / "short.mcap"
    scenario.write_text("[[move]]".join(Path(quick).read_text().split("[[move]]")[:2]))
    settings = (f"source.uri=phantom:{scenario}", "run.realtime=false", f'recording.path="{path}"')
    assemble.build(load_config(None, settings)).run()
    return path


def test_formats_are_those_of_the_command():
    assert command.FORMATS == FORMATS


def test_recordings_keep_their_folders_and_names(folder, tmp_path):
    result = call(
        "export",
        folder / "P01" / "trial.mcap",
        folder / "P02" / "trial.mcap",
        "--format",
        "csv",
        "-o",
        tmp_path / "out",
    )
    assert result.exit_code == 0, result.stderr
    written = {path.relative_to(tmp_path / "out").as_posix() for path in (tmp_path / "out").rglob("*.csv")}
    assert written == {"P01/trial.csv", "P02/trial.csv", "data_dictionary.csv"}
    with (tmp_path / "out" / "P02" / "trial.csv").open(newline="") as file:
        assert {row["recording"] for row in csv.DictReader(file)} == {"P02/trial"}


def test_the_data_dictionary_has_every_column(recording, tmp_path):
    export_runs([recording], "csv", tmp_path / "out")
    with (tmp_path / "out" / "data_dictionary.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    columns = RunTable(recording, "").columns
    assert [(row["column"], row["kind"], row["unit"], row["meaning"]) for row in rows] == [
        (column.name, column.kind, column.unit, column.meaning) for column in columns
    ]


@pytest.mark.parametrize(
    ("kind", "suffix", "module"),
    [("parquet", "parquet", "pyarrow"), ("foxglove", "mcap", "mcap_protobuf"), ("mp4", "mp4", "av")],
)
def test_a_single_recording_becomes_a_file_of_its_name(kind, suffix, module, short, tmp_path):
    pytest.importorskip(module)
    export_runs([short], kind, tmp_path / "out")
    expected = {f"short.{suffix}", "data_dictionary.csv"} | ({"layout.json"} if kind == "foxglove" else set())
    assert {path.name for path in (tmp_path / "out").iterdir()} == expected


def test_the_layout_beside_an_export_shows_its_fields(recording, tmp_path):
    pytest.importorskip("mcap_protobuf")
    export_runs([recording], "foxglove", tmp_path / "out")
    layout = json.loads((tmp_path / "out" / "layout.json").read_text())
    paths = [path["value"] for config in layout["configById"].values() for path in config.get("paths", ())]
    names = {column.name for column in RunTable(recording, "").columns}
    assert {"theta_deg", "state", "plays", "amplitude"} <= {path.removeprefix("/step.") for path in paths}
    assert all(path.removeprefix("/step.") in names for path in paths)


def test_a_damaged_recording_leaves_nothing(folder, tmp_path):
    damaged = folder / "P02" / "trial.mcap"
    data = bytearray(damaged.read_bytes())
    data[len(data) // 2] ^= 0xFF
    damaged.write_bytes(data)
    out = tmp_path / "out"
    assert str(damaged) in refuse(
        "export", folder / "P01" / "trial.mcap", damaged, "--format", "csv", "-o", out
    )
    assert [path.name for path in tmp_path.iterdir()] == ["recordings"]


def test_bad_options_are_refused(recording, tmp_path):
    out = tmp_path / "out"
    assert "--format and -o go together" in refuse("export", recording, "--format", "csv")
    assert "--format and -o go together" in refuse("export", recording, "-o", out)
    assert "--lossless goes with --format lerobot" in refuse(
        "export", recording, "--format", "csv", "-o", out, "--lossless"
    )
    assert "give one recording" in refuse("export", recording, recording, "--xdf", tmp_path / "x.xdf")
    assert "is given twice" in refuse("export", recording, recording, "--format", "csv", "-o", out)
    assert "is to be a folder" in refuse("export", recording, "--format", "csv", "-o", tmp_path / "out.csv")
    inside = out / "none"
    assert f"{inside}: cannot be written" in refuse("export", recording, "--format", "csv", "-o", inside)
    out.mkdir()
    assert f"{out}: exists already" in refuse("export", recording, "--format", "csv", "-o", out)


def test_one_file_of_an_unknown_format_is_refused(recording, tmp_path):
    with pytest.raises(BadInput, match="format"):
        export_run(recording, "lerobot", tmp_path / "run")
    assert set(runs.ONE_FILE_EACH) == set(FORMATS) - {"lerobot"}
