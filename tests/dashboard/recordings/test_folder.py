"""The routes of the recordings page from outside, and the folder behind them."""

import http.client
import json
import os
import shutil
from pathlib import Path
from urllib.parse import urlencode

import cv2
import numpy as np
import pytest
from helpers import call, refuse
from hypothesis import given
from hypothesis import strategies as st
from live_bench import Live
from paths import DATA

from haptigraph.analysis.archive.index import update_archive
from haptigraph.analysis.metrics.timeline import Timeline
from haptigraph.assemble import procedure_names
from haptigraph.dashboard.recordings.folder import RecordingFolder
from haptigraph.errors import BadInput
from haptigraph.recording.reader import RunReader


def get(live, path, method="GET", **parameters):
    connection = http.client.HTTPConnection(live.url.removeprefix("http://").partition("/")[0], timeout=60)
    connection.request(method, f"{path}?{urlencode(parameters)}")
    response = connection.getresponse()
    data = response.read()
    connection.close()
    return response.status, data


def messages(data):
    while data:
        length = int.from_bytes(data[:4], "big")
        content = json.loads(data[4 : 4 + length])
        end = 4 + length + content["bytes"]
        yield content, data[4 + length : end]
        data = data[end:]


def test_a_timeline_is_sent_in_columns_and_its_steps_singly(archive, recordings):
    (*_, (content, data)) = messages(get(archive, "/recordings/timeline", name="p08/again.mcap")[1])
    assert content["type"] == "timeline"
    records = list(RunReader(recordings / "p08" / "again.mcap").records(images=()))
    timeline = Timeline(
        content["states"], [name[8:] for name, *_ in content["columns"] if "measure:" in name]
    )
    for _, step in records:
        timeline.add(step)
    expected = {"time_ms": timeline.time_ms, "edge_ms": timeline.edge_ms, "state": timeline.state}
    expected |= {"plays": timeline.plays, "edge_amplitude": timeline.edge_amplitude}
    expected |= {f"measure:{name}": column for name, column in timeline.measures.items()}
    at = 0
    for name, kind, length in content["columns"]:
        column = np.frombuffer(data, f"<{kind}", length, at)
        assert np.array_equal(column, np.asarray(expected.pop(name)), equal_nan=kind[0] == "f")
        at += column.nbytes
    assert (at, expected) == (len(data), {})
    status, data = get(archive, "/recordings/step", name="p08/again.mcap", number=40)
    length = int.from_bytes(data[:4], "big")
    header = json.loads(data[4 : 4 + length])
    capture, step = list(RunReader(recordings / "p08" / "again.mcap").records())[40]
    assert (status, header["state"], header["index"]) == (200, step.conclusion.state, step.index)
    assert data[4 + length :] == capture.encoded  # byte for byte as recorded


def test_an_invalid_step_number_is_refused(archive):
    get(archive, "/recordings/timeline", name="quick.mcap")
    for number in ("-1", "117", "1e3", "nan", "", "9" * 40):
        status, data = get(archive, "/recordings/step", name="quick.mcap", number=number)
        assert status == 422, number
        assert json.loads(data)["problem"].startswith("quick.mcap: ")


@pytest.mark.parametrize(
    "name", ["../quick.mcap", "/etc/passwd", "link.mcap", "", "p08/../../x", "a\0b", "none"]
)
@pytest.mark.parametrize("job", ["timeline", "compare", "csv", "png"])
def test_nothing_outside_the_folder_is_opened(archive, job, name):
    ((content, _),) = messages(get(archive, f"/recordings/{job}", name=name)[1])
    assert content["type"] == "problem"
    assert "recordings" in content["problem"] or "does not exist" in content["problem"]


@pytest.mark.parametrize(
    ("compared", "sentence"),
    [
        ("nothing", "unknown procedure"),
        ("../x.toml", "not in the folder"),
        ("quick.mcap", "unknown procedure"),
    ],
)
def test_an_invalid_procedure_is_refused(archive, compared, sentence):
    (*_, (content, _)) = messages(
        get(archive, "/recordings/compare", name="quick.mcap", procedure=compared)[1]
    )
    assert content["type"] == "problem"
    assert sentence in content["problem"]


def test_the_door_is_the_same_for_all_pages(archive, calm_uri, recordings):
    assert get(archive, "/recordings/list", method="POST")[0] == 403
    assert get(archive, "/recordings/nothing")[0] == 404
    with Live(calm_uri, "--recordings", recordings, "--token", "secret") as live:
        for path in ("/recordings", "/recordings/list", "/recordings/step", "/recordings/timeline"):
            assert get(live, path, name="quick.mcap")[0] == 403


def test_the_list_is_made_from_headers_and_includes_invalid_files(recordings):
    found = RecordingFolder(recordings).list_runs()
    rows = {row["name"]: row for row in found["runs"]}
    assert rows.keys() == {"quick.mcap", "killed.mcap", "damaged.mcap", "notes.mcap", "p08/again.mcap"}
    assert rows["quick.mcap"]["length_s"] == pytest.approx(7.7, abs=0.1)
    assert (rows["quick.mcap"]["participant"], rows["quick.mcap"]["trial"]) == ("P07", "3")
    assert (rows["killed.mcap"]["is_whole"], rows["killed.mcap"]["length_s"]) == (False, None)
    assert rows["notes.mcap"]["problem"].startswith("not a recording")
    assert found["procedures"] == [*procedure_names(), "wide.toml"]


@given(name=st.text(st.sampled_from("./\\~ab\0%é"), max_size=12))
def test_no_name_leads_out_of_the_folder(recordings, name):
    folder = RecordingFolder(recordings)
    try:
        path = folder.path_of(name)
    except BadInput:
        return
    assert path.is_relative_to(recordings.resolve())


def test_steps_of_a_file_that_was_replaced_are_refused(recordings, tmp_path):
    path = tmp_path / "run.mcap"
    path.write_bytes((recordings / "quick.mcap").read_bytes())
    folder = RecordingFolder(tmp_path)
    folder.open_run("run.mcap", [place for place, _ in RunReader(path).places()])
    assert folder.step("run.mcap", 5)
    other = tmp_path / "other"
    other.write_bytes((recordings / "killed.mcap").read_bytes())
    os.replace(other, path)
    with pytest.raises(BadInput, match="has changed since it was opened"):
        folder.step("run.mcap", 5)
    with pytest.raises(BadInput, match="not open any more"):
        RecordingFolder(tmp_path).step("run.mcap", 5)


def test_a_missing_folder_is_refused(quick, tmp_path):
    for folder in (quick, tmp_path / "none"):
        line = refuse("live", "--recordings", folder)
        assert "is no folder" in line and str(Path(folder)) in line


def test_without_a_source_the_address_of_the_recordings_is_printed(recordings):
    with Live("--recordings", recordings, "--no-browser") as live:
        assert f"haptigraph: the recordings are at {live.url}recordings; " in "".join(live.lines)


def test_a_recording_of_version_0_1_is_listed_drawn_and_exported(calm_uri):
    with Live(calm_uri, "--recordings", DATA / "v0_1") as live:
        (row,) = json.loads(get(live, "/recordings/list")[1])["runs"]
        assert (row["version"], row["problem"], row["is_whole"]) == ("0.1.0", "", True)
        (*_, (content, _)) = messages(get(live, "/recordings/timeline", name="run.mcap")[1])
        assert content["type"] == "timeline"
        status, csv = get(live, "/recordings/csv", name="run.mcap")
        assert status == 200 and b"needle" in csv
        assert get(live, "/recordings/step", name="run.mcap", number=60)[0] == 200


def test_a_run_of_volumes_replays_identically_and_is_shown_in_three_sections(quick_volume, tmp_path):
    path = tmp_path / "volumes.mcap"
    settings = ("--procedure", "subretinal_injection_4d", "--fast", "--record", str(path))
    run = call("run", f"phantom:{quick_volume}", *settings)
    assert run.exit_code == 0, run.output
    assert "4 volumes/s: haptic output ends 375 ms after the last one" in run.output
    replay = call("replay", str(path))
    assert replay.exit_code == 0 and "21 of 21 steps identical" in replay.output
    folder = RecordingFolder(tmp_path)
    places = [place for place, _ in RunReader(path).places()]
    folder.open_run("volumes.mcap", places)
    message = folder.step("volumes.mcap", 12)
    length = int.from_bytes(message[:4], "big")
    header = json.loads(message[4 : 4 + length])
    main, across, above = header["found"], *header["beside"]
    assert {"ilm", "needle_line"} <= set(main) == set(across)
    assert set(above) == {name for name in main if name.startswith("needle")}
    assert header["found"]["ilm"]["type"] == "polyline"
    picture = cv2.imdecode(np.frombuffer(message[4 + length :], np.uint8), cv2.IMREAD_UNCHANGED)
    assert picture.shape == (720, 720) and picture.std() > 20


def test_recordings_are_found_in_the_archive_of_the_folder(calm_uri, recordings, tmp_path):
    folder = Path(shutil.copytree(recordings, tmp_path / "recordings", symlinks=True))
    with Live(calm_uri, "--recordings", folder) as live:
        ((content, _),) = messages(get(live, "/recordings/find")[1])
        assert "has no archive; create one with `haptigraph archive" in content["problem"]
        update_archive(folder)
        ((content, _),) = messages(get(live, "/recordings/find", filter='{"state": "target_hit"}')[1])
        steps = [step for _, step in RunReader(folder / "quick.mcap").records(images=())]
        first = next(number for number, step in enumerate(steps) if step.conclusion.state == "target_hit")
        assert [(row["recording"], row["first_step"]) for row in content["rows"]] == [
            ("p08/again.mcap", first), ("quick.mcap", first),
        ]  # fmt: skip
        assert content["is_complete"] and content["note"] == ""
        for fields, problem in (
            ("{", "filter: Input data was truncated"),
            ('{"conditions": [{"measure": "1 or true", "way": "above", "value": 1}]}', "unknown measure"),
        ):
            ((content, _),) = messages(get(live, "/recordings/find", filter=fields)[1])
            assert problem in content["problem"]
