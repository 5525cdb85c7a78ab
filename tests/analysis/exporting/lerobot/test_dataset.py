"""The dataset for LeRobot, read with pyarrow and PyAV; `make test-exports` reads it with LeRobot itself."""

import csv
import json
import sys

import cv2
import numpy as np
import pytest

from haptigraph import assemble
from haptigraph.analysis.exporting.columns import RunTable
from haptigraph.analysis.exporting.lerobot import files
from haptigraph.analysis.exporting.lerobot.features import IMAGE
from haptigraph.analysis.exporting.runs import export_runs
from haptigraph.config import load_config
from haptigraph.errors import BadInput, MissingExtra
from haptigraph.version import __version__

parquet = pytest.importorskip("pyarrow.parquet")
av = pytest.importorskip("av")


@pytest.fixture(scope="module")
def dataset(recording, tmp_path_factory):
    """The same run twice, without loss, each in files of its own."""
    folder = tmp_path_factory.mktemp("lerobot") / "dataset"
    other = folder.parent / "other.mcap"
    other.write_bytes(recording.read_bytes())
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(files, "DATA_MB", 0)
        patch.setattr(files, "VIDEO_MB", 0)
        export_runs([recording, other], "lerobot", folder, is_lossless=True)
    return folder


@pytest.fixture(scope="module")
def rows(recording):
    return [*RunTable(recording, "").rows(images=True)]


@pytest.fixture(scope="module")
def info(dataset):
    return json.loads((dataset / "meta" / "info.json").read_text())


@pytest.fixture(scope="module")
def table(dataset, info):
    """The steps of the second episode."""
    return parquet.read_table(dataset / info["data_path"].format(chunk_index=0, file_index=1))


@pytest.fixture(scope="module")
def episodes(dataset):
    return parquet.read_table(dataset / "meta" / "episodes" / "chunk-000" / "file-000.parquet").to_pylist()


def test_every_feature_is_described_and_has_its_type_and_shape(info, table):
    features = info["features"]
    assert set(table.column_names) == set(features) - {IMAGE}
    for name in table.column_names:
        about, found = features[name], table.schema.field(name).type
        width = about["shape"][0]
        kind = about["dtype"].replace("float32", "float")
        assert str(found) == (
            kind
            if width == 1
            else f"fixed_size_list<element: {kind}>[{width}]".replace("element", found.value_field.name)
        )
        assert about["names"] is None or len(about["names"]) == width
    assert info["codebase_version"] == "v3.0"
    assert (info["total_episodes"], info["total_frames"]) == (2, 2 * table.num_rows)


def test_numbers_are_those_of_the_recording_and_nan_where_unknown(info, table, rows, recording):
    columns = {column.name: column for column in RunTable(recording, "").columns}
    names = info["features"]["observation.state"]["names"]
    assert {"theta_deg", "needle_tip_x_mm", "needle_tip_sd_mm"} <= set(names)
    assert "theta_sd_deg" not in names  # never known: the procedure has no margin
    expected = np.array([[columns[name].value(row) for name in names] for row in rows], np.float64)
    found = np.array(table["observation.state"].to_pylist())
    np.testing.assert_array_equal(found, expected.astype(np.float32))
    assert np.isnan(found).any()
    assert table["stamp_ns"].to_pylist() == [row.step.stamp_ns for row in rows]
    assert table["surgical_state"].to_pylist() == [row.step.conclusion.state for row in rows]


def test_triplets_and_the_number_of_the_state_are_those_of_the_recording(info, table, rows, recording):
    names = info["features"]["scene_graph.triplets"]["names"]
    states = [state.name for state in RunTable(recording, "").procedure.states]
    for row, held, number in zip(
        rows,
        table["scene_graph.triplets"].to_pylist(),
        table["surgical_state_index"].to_pylist(),
        strict=True,
    ):
        edges = {str(edge) for edge in row.step.graph.edges}
        assert {name for name, holds in zip(names, held, strict=True) if holds} == edges
        assert states[number] == row.step.conclusion.state


def test_every_pixel_of_the_lossless_video_is_that_of_the_recording(dataset, info, rows):
    path = dataset / info["video_path"].format(video_key=IMAGE, chunk_index=0, file_index=1)
    with av.open(str(path)) as container:
        pictures = [frame.to_ndarray(format="rgb24") for frame in container.decode(video=0)]
        assert container.streams.video[0].average_rate == info["fps"]
    assert len(pictures) == len(rows)
    missing = 0
    for picture, row in zip(pictures, rows, strict=True):
        if row.capture.image is None:
            assert not picture.any()
            missing += 1
        else:
            assert np.array_equal(picture, cv2.cvtColor(row.capture.image, cv2.COLOR_BGR2RGB))
    assert missing < len(rows) / 2


def test_episodes_lead_to_their_data_and_video(episodes, rows, info):
    count = len(rows)
    assert [(one["dataset_from_index"], one["dataset_to_index"]) for one in episodes] == [
        (0, count),
        (count, 2 * count),
    ]
    assert [one["data/file_index"] for one in episodes] == [0, 1]
    assert [one[f"videos/{IMAGE}/file_index"] for one in episodes] == [0, 1]
    assert [one[f"videos/{IMAGE}/from_timestamp"] for one in episodes] == [0, 0]
    assert episodes[1][f"videos/{IMAGE}/to_timestamp"] == pytest.approx(count / info["fps"])


def test_without_a_limit_of_size_episodes_share_files(recording, tmp_path):
    other = tmp_path / "other.mcap"
    other.write_bytes(recording.read_bytes())
    export_runs([recording, other], "lerobot", tmp_path / "dataset")
    written = [path.name for path in (tmp_path / "dataset").rglob("*") if path.suffix in (".mp4", ".parquet")]
    assert sorted(written) == ["file-000.mp4", "file-000.parquet", "file-000.parquet", "tasks.parquet"]
    episodes = parquet.read_table(
        tmp_path / "dataset" / "meta" / "episodes" / "chunk-000" / "file-000.parquet"
    ).to_pylist()
    assert episodes[1][f"videos/{IMAGE}/from_timestamp"] == episodes[0][f"videos/{IMAGE}/to_timestamp"] > 0


def test_the_dataset_names_no_participant_file_or_date(dataset, recording):
    info = RunTable(recording, "").reader.info
    assert info.participant == "P01"
    texts = [path.read_bytes() for path in dataset.rglob("*") if path.is_file() and path.suffix != ".mp4"]
    for secret in ("P01", recording.name, info.started_utc[:10], info.source):
        assert not any(secret.encode() in text for text in texts), secret


def test_what_is_simulated_says_so(dataset):
    about = json.loads((dataset / "meta" / "haptigraph.json").read_text())
    assert [one["simulated"] for one in about["episodes"]] == [True, True]
    assert about["exported_with"] == __version__
    card = (dataset / "README.md").read_text()
    assert "All episodes are simulated" in card
    assert "not\nwith a medical device" in card


def test_every_channel_is_in_the_data_dictionary(dataset, info):
    with (dataset / "data_dictionary.csv").open(newline="") as file:
        rows = {row["column"]: row for row in csv.DictReader(file)}
    for name, about in info["features"].items():
        names = about["names"] if about["shape"] != [1] and name != IMAGE else None
        assert all(rows[f"{name}: {channel}" if names else name]["meaning"] for channel in names or [name])
    assert rows["observation.state: theta_deg"]["unit"] == "deg"
    assert rows["stamp_ns"]["unit"] == "ns"


def test_json_is_valid_for_strict_readers(dataset):
    def refuse_constant(text):
        raise AssertionError(text)

    for path in (dataset / "meta").glob("*.json"):
        json.loads(path.read_text(), parse_constant=refuse_constant)


def test_recordings_that_do_not_fit_together_are_refused(recording, quick_scan, tmp_path):
    other = tmp_path / "other.mcap"
    settings = (
        f"source.uri=phantom:{quick_scan}",
        "run.procedure=subretinal_injection_ioct",
        "run.realtime=false",
        f'recording.path="{other}"',
    )
    assemble.build(load_config(None, settings)).run()
    with pytest.raises(BadInput, match=r"other\.mcap: has another .*; export them as separate datasets"):
        export_runs([recording, other], "lerobot", tmp_path / "dataset")
    assert not (tmp_path / "dataset").exists()


@pytest.mark.parametrize("module", ["av", "pyarrow"])
def test_without_the_libraries_the_extra_is_named(module, recording, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(MissingExtra, match=r"haptigraph\[lerobot\]"):
        export_runs([recording], "lerobot", tmp_path / "dataset")
    assert list(tmp_path.iterdir()) == []
