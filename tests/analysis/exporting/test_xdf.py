import itertools
import math
import struct
import uuid

import numpy as np
import pytest
from helpers import call, refuse
from hypothesis import given, settings
from hypothesis import strategies as st

from haptigraph.analysis.exporting.lsl_streams import LslSamples, LslStream
from haptigraph.analysis.exporting.xdf import XdfFile, run_xdf
from haptigraph.errors import BadInput
from haptigraph.recording.reader import RunReader

pyxdf = pytest.importorskip("pyxdf")

STAMP_TOLERANCE_S = 1e-6
STARTED = ("2026-01-01T00:00:00+00:00", 5.0)


def load(path):
    """The streams of a file by name, as an analysis script loads them."""
    streams, header = pyxdf.load_xdf(str(path))
    return {stream["info"]["name"][0]: stream for stream in streams}, header


@pytest.fixture(scope="module")
def exported(recording, tmp_path_factory):
    path = tmp_path_factory.mktemp("xdf") / "run.xdf"
    counts = run_xdf(recording, path)
    return path, counts


@pytest.fixture(scope="module")
def steps(recording):
    return [step for _, step in RunReader(recording).records(images=())]


def test_measures_have_the_stamps_and_values_of_the_recording(exported, steps):
    measures = load(exported[0])[0]["haptigraph.measures"]
    stamps_s = [step.stamp_ns / 1e9 for step in steps]
    assert np.allclose(measures["time_stamps"], stamps_s, rtol=0, atol=STAMP_TOLERANCE_S)
    labels = [each["label"][0] for each in measures["info"]["desc"][0]["channels"][0]["channel"]]
    assert {"theta_deg", "distance_to_retina_mm"} <= set(labels)
    expected = [[step.graph.measures.get(label, math.nan) for label in labels] for step in steps]
    assert np.array_equal(measures["time_series"], expected, equal_nan=True)
    assert np.isnan(expected).any() and not np.isnan(expected).all()


def test_markers_are_the_changes_of_the_recording(exported, steps):
    streams = load(exported[0])[0]
    changes = [
        (step.stamp_ns, step.conclusion.state)
        for before, step in itertools.pairwise([None, *steps])
        if before is None or step.conclusion.state != before.conclusion.state
    ]
    assert len(changes) > 2
    state = streams["haptigraph.state"]
    assert [value for (value,) in state["time_series"]] == [name for _, name in changes]
    assert np.allclose(state["time_stamps"], [ns / 1e9 for ns, _ in changes], rtol=0, atol=STAMP_TOLERANCE_S)
    commands = [
        (step.timing.commanded_ns, step.command.pattern.name)
        for before, step in itertools.pairwise([None, *steps])
        if before is None
        or (step.command.pattern.name, step.command.since_ns)
        != (before.command.pattern.name, before.command.since_ns)
    ]
    command = streams["haptigraph.command"]
    assert [value for (value,) in command["time_series"]] == [name for _, name in commands]
    assert np.allclose(
        command["time_stamps"], [ns / 1e9 for ns, _ in commands], rtol=0, atol=STAMP_TOLERANCE_S
    )


def test_streams_are_described_as_those_of_the_bridge(exported, recording):
    streams, header = load(exported[0])
    info = RunReader(recording).info
    assert header["info"]["version"] == ["1.0"]
    assert {name: stream["info"]["type"][0] for name, stream in streams.items()} == {
        "haptigraph.state": "Markers",
        "haptigraph.command": "Markers",
        "haptigraph.measures": "Misc",
    }
    for stream in streams.values():
        assert stream["info"]["nominal_srate"] == ["0"]
        described = stream["info"]["desc"][0]
        assert described["procedure_sha256"] == [info.procedure_sha256]
        assert described["participant"] == ["P01"]
        assert stream["footer"]["info"]["sample_count"] == [str(len(stream["time_stamps"]))]
    assert exported[1] == {name: len(stream["time_stamps"]) for name, stream in streams.items()}


def test_without_corrections_the_stamps_are_the_same(exported):
    corrected, _ = pyxdf.load_xdf(str(exported[0]))
    raw, _ = pyxdf.load_xdf(str(exported[0]), synchronize_clocks=False, dejitter_timestamps=False)
    for one, other in zip(corrected, raw, strict=True):
        assert np.array_equal(one["time_stamps"], other["time_stamps"])


@settings(max_examples=15)
@given(
    texts=st.lists(st.text(max_size=300), max_size=5),
    numbers=st.lists(st.tuples(st.floats(), st.floats()), max_size=5),
    start_s=st.floats(0, 1e7),
)
def test_any_text_and_number_survives(tmp_path_factory, texts, numbers, start_s):
    file = XdfFile(*STARTED)
    words = file.add_stream(LslStream("words", "Markers", ("word",), {"note": "a < b & 'c'"}))
    pairs = file.add_stream(LslStream("pairs", "Misc", ("a_mm", "b_deg"), {}))
    for index, text in enumerate(texts):
        file.add_sample(words, (text,), start_s + index)
    for index, pair in enumerate(numbers):
        file.add_sample(pairs, pair, start_s + index)
    path = tmp_path_factory.mktemp("any") / "any.xdf"
    path.write_bytes(file.content())
    streams, _ = load(path)
    assert [value for (value,) in streams["words"]["time_series"]] == texts
    assert np.array_equal(
        np.reshape(streams["pairs"]["time_series"], (-1, 2)), np.reshape(numbers, (-1, 2)), equal_nan=True
    )
    assert list(streams["words"]["time_stamps"]) == [start_s + index for index in range(len(texts))]
    assert streams["words"]["info"]["desc"][0]["note"] == ["a < b & 'c'"]
    assert streams["pairs"]["info"]["desc"][0]["channels"][0]["channel"][0]["unit"] == ["millimeters"]


def test_many_samples_need_a_longer_length(tmp_path):
    file = XdfFile(*STARTED)
    words = file.add_stream(LslStream("words", "Markers", ("word",), {}))
    for index in range(70_000):
        file.add_sample(words, ("x",), float(index))
    (tmp_path / "many.xdf").write_bytes(file.content())
    assert len(load(tmp_path / "many.xdf")[0]["words"]["time_stamps"]) == 70_000


def test_chunks_are_those_of_the_specification(exported):
    data = exported[0].read_bytes()
    assert data[:4] == b"XDF:"
    tags, at = [], 4
    while at < len(data):
        size_bytes = data[at]
        length = int.from_bytes(data[at + 1 : at + 1 + size_bytes], "little")
        (tag,) = struct.unpack_from("<H", data, at + 1 + size_bytes)
        tags.append(tag)
        at += 1 + size_bytes + length
        if tag == 5:
            assert data[at - 16 : at] == uuid.UUID("43a546dc-cbf5-410f-b30e-d5467383cbe4").bytes
    assert tags == [1, 2, 2, 2, 3, 3, 3, 5, 4, 4, 6, 4, 4, 6, 4, 4, 6]


def test_a_run_without_a_change_has_one_marker_each(steps):
    samples = LslSamples(())
    first, again = (list(samples.of_step(steps[0])) for _ in range(2))
    assert [sample.stream for sample in first] == ["measures", "state", "command"]
    assert [sample.stream for sample in again] == ["measures"]


def test_the_command_writes_once_and_overwrites_nothing(recording, tmp_path):
    path = tmp_path / "run.xdf"
    result = call("export", recording, "--xdf", path)
    assert result.exit_code == 0
    assert "haptigraph.measures" in result.stdout
    before = path.read_bytes()
    assert f"{path}: exists already" in refuse("export", recording, "--xdf", path)
    assert path.read_bytes() == before
    with pytest.raises(BadInput, match="exists already"):
        run_xdf(recording, path)
    layout = tmp_path / "layout.json"
    refuse("export", recording, "--foxglove-layout", layout, "--xdf", path)
    assert not layout.exists()  # all or nothing
    assert "nothing to write; give --format and -o, --xdf FILE or --foxglove-layout FILE" in refuse(
        "export", recording
    )
    assert "cannot be written" in refuse("export", recording, "--xdf", tmp_path / "none" / "run.xdf")
    with pytest.raises(BadInput):
        run_xdf(tmp_path / "none.mcap", tmp_path / "new.xdf")
    assert not (tmp_path / "new.xdf").exists()
