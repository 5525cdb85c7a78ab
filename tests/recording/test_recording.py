import json
import signal
import subprocess
import sys
from itertools import islice

import msgspec
import numpy as np
import pytest
from helpers import make_step
from mcap.reader import make_reader

from haptigraph.assemble import build, build_pipeline, open_source
from haptigraph.clock import VirtualClock
from haptigraph.config import Config, load_config
from haptigraph.errors import BadInput, EndOfSource
from haptigraph.geometry import ImageGeometry
from haptigraph.messages import Capture, Fault, Truth
from haptigraph.recording.codec import decode, encode_jpeg, encode_png, format_of
from haptigraph.recording.foxglove import CompressedImage, ImageAnnotations, foxglove_schema
from haptigraph.recording.journal import Journal
from haptigraph.recording.reader import RunReader
from haptigraph.recording.schema import TOPICS, RunInfo, mcap_schema
from haptigraph.recording.writer import RunWriter
from haptigraph.registration.loading import parse_registration

GEOMETRY = ImageGeometry((10.0, 10.0), 0.1, mirrored=False)
INFO = RunInfo("0", "2026-01-01T00:00:00+00:00", 10**18, "test", 30.0, "{}", "r", "rr", "p", "pp")
IMAGE = np.arange(400, dtype=np.uint8).reshape(20, 20)


def test_the_header_contains_everything_a_replay_needs(recording_file, quick_uri):
    info = RunReader(recording_file).info
    config = msgspec.json.decode(info.config, type=Config)
    assert config.source.uri == quick_uri
    assert parse_registration(info.registration, "x").sha256 == info.registration_sha256
    assert info.procedure.startswith("# Subretinal injection")
    assert (info.participant, info.trial) == ("P07", "3")
    assert info.rate_hz == 15


def test_replaying_the_images_gives_bit_identical_steps(recording_file, procedure):
    reader = RunReader(recording_file)
    config = msgspec.json.decode(reader.info.config, type=Config)
    pipeline = build_pipeline(config, parse_registration(reader.info.registration, "x"), procedure)
    count = 0
    for capture, recorded in reader.records():
        again = pipeline.step(capture)
        for message in ("observation", "graph", "conclusion", "command"):
            assert msgspec.json.encode(getattr(again, message)) == msgspec.json.encode(
                getattr(recorded, message)
            )
        count += 1
    assert count == 117  # 116 images and the end


def test_the_recorded_bytes_are_those_that_perception_consumed(recording_file, quick_uri):
    source = open_source(load_config(None, (f"source.uri={quick_uri}",)), VirtualClock())
    try:
        for capture, _ in islice(RunReader(recording_file).records(), 10):
            original = source.read(1.0)
            assert capture.encoded == original.encoded
            assert np.array_equal(capture.image, original.image)
            assert capture.truth == original.truth
    finally:
        source.close()


def test_raw_images_are_recorded_losslessly(quick_uri, tmp_path):
    settings = (f"source.uri={quick_uri}", "run.realtime=false", "source.jpeg_quality=0")
    config = load_config(None, (*settings, f'recording.path="{tmp_path / "raw.mcap"}"'))
    build(config).run()
    source = open_source(config, VirtualClock())
    for capture, _ in islice(RunReader(tmp_path / "raw.mcap").records(), 5):
        assert format_of(capture.encoded) == "png"
        assert np.array_equal(capture.image, source.read(1.0).image)
    source.close()


def test_topics_and_schemas_are_those_of_the_table(recording_file):
    with recording_file.open("rb") as file:
        summary = make_reader(file).get_summary()
    schemas = {channel.topic: summary.schemas[channel.schema_id] for channel in summary.channels.values()}
    assert {topic: schema.name for topic, schema in schemas.items()} == {t.name: t.schema for t in TOPICS}
    assert all(schema.encoding == "jsonschema" for schema in schemas.values())
    graph = json.loads(schemas["/graph"].data)
    assert graph["properties"]["measures"]["properties"]["theta_deg"] == {"type": "number"}


def check_supported(schema) -> None:
    """Check that Foxglove's JSON reader supports a schema."""
    kind = schema["type"]
    assert kind in ("object", "array", "string", "number", "integer", "boolean")
    if kind == "object":
        for field in schema["properties"].values():
            check_supported(field)
    if kind == "array":
        assert schema["items"]["type"] != "array"
        check_supported(schema["items"])


@pytest.mark.parametrize("topic", TOPICS, ids=lambda topic: topic.name)
def test_schemas_use_only_what_foxglove_supports(topic):
    schema = mcap_schema(topic, ("theta_deg",))
    assert schema["type"] == "object"
    check_supported(schema)


def test_images_are_base64_for_foxglove():
    schema = foxglove_schema(CompressedImage, "foxglove.CompressedImage")
    assert schema["properties"]["data"] == {"type": "string", "contentEncoding": "base64"}
    assert set(schema["properties"]) == {"timestamp", "frame_id", "data", "format"}
    assert set(foxglove_schema(ImageAnnotations, "x")["properties"]) == {"circles", "points", "texts"}


def test_a_schema_must_be_of_an_object():
    with pytest.raises((TypeError, KeyError)):
        foxglove_schema(int, "x")


def test_log_times_are_wall_clock(recording_file):
    info = RunReader(recording_file).info
    with recording_file.open("rb") as file:
        _, _, message = next(make_reader(file).iter_messages())
    assert message.log_time == info.utc_offset_ns  # the first stamp of a fast run is 0
    assert message.log_time > 1.7e18


def test_only_selected_images_are_decoded(recording_file):
    captures = [capture for capture, _ in islice(RunReader(recording_file).records(images={2}), 5)]
    assert [capture.image is not None for capture in captures] == [False, False, True, False, False]


def write(path, *items):
    writer = RunWriter(path, INFO, GEOMETRY, ())
    for capture, step, dropped in items:
        writer.write(capture, step, dropped=dropped)
    writer.close()
    return RunReader(path)


def test_faults_truth_and_missing_images_are_read_back(tmp_path):
    fault = Fault("source", "stale image")
    truth = Truth(True, True, (1.0, 2.0), (0.1, 0.2), 3.0, 4.0)
    reader = write(
        tmp_path / "a.mcap",
        (Capture(0, 5, IMAGE, truth=truth), make_step(stamp_ns=5), False),
        (Capture(0, 6, None, faults=(fault,)), make_step(stamp_ns=6, faults=(fault,)), False),
        (Capture(1, 7, None), make_step(stamp_ns=7), True),
    )
    (first, _), (second, step), (third, _) = reader.records()
    assert np.array_equal(first.image, IMAGE)
    assert first.truth == truth
    assert (second.image, second.faults, step.faults) == (None, (fault,), (fault,))
    assert third.image is None
    assert reader.count() == (3, 1)


def test_a_recording_never_overwrites(tmp_path):
    file = tmp_path / "a.mcap"
    file.write_text("precious")
    with pytest.raises(BadInput, match="exists already; a recording never overwrites a file"):
        RunWriter(file, INFO, GEOMETRY, ())
    assert file.read_text() == "precious"
    with pytest.raises(BadInput, match="cannot be written"):
        RunWriter(tmp_path / "no" / "a.mcap", INFO, GEOMETRY, ())


@pytest.mark.parametrize("error", [KeyboardInterrupt(), OSError(28, "No space left on device")])
def test_a_recording_that_fails_to_start_leaves_no_file(tmp_path, monkeypatch, error):
    def fail(self, data):
        raise error

    monkeypatch.setattr(Journal, "write", fail)
    with pytest.raises((KeyboardInterrupt, BadInput)) as raised:
        RunWriter(tmp_path / "a.mcap", INFO, GEOMETRY, ())
    if isinstance(error, OSError):
        assert str(raised.value) == f"{tmp_path / 'a.mcap'}: cannot be written (No space left on device)"
    assert list(tmp_path.iterdir()) == []


def test_discarding_a_finished_recording_keeps_it(tmp_path):
    writer = RunWriter(tmp_path / "a.mcap", INFO, GEOMETRY, ())
    assert not writer.is_complete
    writer.write(Capture(0, 0, None), make_step())
    writer.close()
    writer.discard()
    assert writer.is_complete
    assert RunReader(tmp_path / "a.mcap").is_whole


def test_a_run_without_steps_leaves_no_file(tmp_path):
    writer = RunWriter(tmp_path / "empty.mcap", INFO, GEOMETRY, ())
    writer.close()
    writer.close()
    assert list(tmp_path.iterdir()) == []


def test_a_recording_of_a_future_format_is_rejected(tmp_path):
    writer = RunWriter(tmp_path / "b.mcap", msgspec.structs.replace(INFO, format="99"), GEOMETRY, ())
    writer.write(Capture(0, 0, None), make_step())
    writer.close()
    with pytest.raises(BadInput, match="recording format '99'; this version reads 1, 2"):
        RunReader(tmp_path / "b.mcap")


def test_an_mcap_file_of_other_software_is_rejected(tmp_path):
    from mcap.writer import Writer

    with (tmp_path / "other.mcap").open("wb") as file:
        writer = Writer(file)
        writer.start()
        writer.finish()
    with pytest.raises(BadInput, match="not a recording of haptigraph"):
        RunReader(tmp_path / "other.mcap")


def test_png_is_lossless_and_other_bytes_are_rejected():
    colour = np.random.default_rng(0).integers(0, 255, (16, 16, 3)).astype(np.uint8)
    for image in (IMAGE, colour):
        assert np.array_equal(decode(encode_png(image)), image)
        jpeg = encode_jpeg(image, 95)
        assert format_of(jpeg) == "jpeg"
        assert decode(jpeg).shape == image.shape
    for garbage in (b"", b"not an image"):
        with pytest.raises(ValueError, match="not an 8-bit image"):
            decode(garbage)


CHILD = """
import sys
from haptigraph.assemble import build
from haptigraph.config import load_config
settings = (f"source.uri={sys.argv[1]}", "source.loop=true", f'recording.path="{sys.argv[2]}"')
for step in build(load_config(None, settings)).steps():
    print(step.stamp_ns, flush=True)
"""


def test_kill_9_loses_at_most_one_second(quick_uri, tmp_path):
    file = tmp_path / "killed.mcap"
    with subprocess.Popen(
        [sys.executable, "-c", CHILD, quick_uri, str(file)], stdout=subprocess.PIPE, text=True
    ) as child:
        stamps = [int(line) for line in islice(child.stdout, 60)]
        child.send_signal(signal.SIGKILL)
        stamps += [int(line) for line in child.stdout if line.endswith("\n")]
    reader = RunReader(file)
    assert not reader.is_whole
    read_back = [step.stamp_ns for capture, step in reader.records() if capture.image is not None]
    assert read_back == stamps[: len(read_back)]
    assert stamps[-1] - read_back[-1] <= 1e9


def test_an_interrupted_recording_can_be_a_source(journal_file, tmp_path):
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(journal_file.read_bytes()[:-200_000])
    source = open_source(load_config(None, (f'source.uri="{cut}"',)), VirtualClock())
    count = 0
    with pytest.raises(EndOfSource):
        while source.read(1.0) is not None:
            count += 1
    source.close()
    assert 50 < count < 117
