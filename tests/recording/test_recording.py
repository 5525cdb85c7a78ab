import json
import os
import re
import signal
import subprocess
import sys
from collections.abc import Callable
from contextlib import suppress
from functools import cache
from hashlib import sha256
from io import BytesIO
from itertools import islice
from pathlib import Path

import fastjsonschema
import msgspec
import numpy as np
import pytest
from helpers import make_step
from mcap.exceptions import EndOfFile
from mcap.reader import NonSeekingReader, make_reader
from mcap.records import Message
from mcap.writer import Writer
from msgspec.structs import replace

from haptigraph.analysis.metrics.replay import recorded_config, replay
from haptigraph.assemble import build, build_pipeline, open_source
from haptigraph.clock import VirtualClock
from haptigraph.config import Config, load_config
from haptigraph.errors import BadInput, EndOfSource
from haptigraph.geometry import Point
from haptigraph.messages import CERTAIN, CameraStamp, Capture, Certainty, Fault, HandState, Truth
from haptigraph.projection import ImageGeometry
from haptigraph.recording.codec import decode, encode_jpeg, encode_png, format_of
from haptigraph.recording.decoding import decode_message
from haptigraph.recording.entries import entries
from haptigraph.recording.foxglove import CompressedImage, ImageAnnotations, encode_message, foxglove_schema
from haptigraph.recording.header import header_record
from haptigraph.recording.journal import FileChanged, Journal
from haptigraph.recording.reader import RunReader
from haptigraph.recording.recovery import recover
from haptigraph.recording.schema import TOPICS, RunInfo, mcap_schema
from haptigraph.recording.writer import RunWriter
from haptigraph.registration.loading import parse_registration

GEOMETRY = ImageGeometry((10.0, 10.0), 0.1, mirrored=False)
SHA = {text: sha256(text.encode()).hexdigest() for text in "rp"}
INFO = RunInfo("0", "2026-01-01T00:00:00+00:00", 10**18, "test", 30.0, "{}", "r", SHA["r"], "p", SHA["p"])
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


def test_a_run_of_a_recording_has_the_same_steps(recording_file, tmp_path):
    again = tmp_path / "again.mcap"
    settings = (f"source.uri={recording_file}", "run.realtime=false", f'recording.path="{again}"')
    build(load_config(None, settings)).run()
    recorded, repeated = (list(RunReader(path).records()) for path in (recording_file, again))
    assert [capture.image is None for capture, _ in recorded[-2:]] == [False, True]
    assert [step.conclusion for _, step in repeated] == [step.conclusion for _, step in recorded]


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


@cache
def checker(schema: str) -> Callable[[object], object]:
    return fastjsonschema.compile(json.loads(schema))


def invalid(topic: str, message: dict, schema: str) -> str | None:
    """Return what is wrong with a message, if anything."""
    try:
        checker(schema)(message)
    except fastjsonschema.JsonSchemaValueException as error:
        return f"{topic}: {error.message}"
    return None


def test_every_message_satisfies_its_schema(recording_file):
    with recording_file.open("rb") as file:
        wrong = [
            invalid(channel.topic, json.loads(message.data), schema.data.decode())
            for schema, channel, message in islice(make_reader(file).iter_messages(), 400)
        ]
    assert len(wrong) == 400
    assert set(wrong) == {None}


FULL = Capture(
    3,
    1,
    IMAGE,
    faults=(Fault("source", "lost"),),
    truth=Truth(True, True, (1.0, 2.0), (0.1, 0.2), 3.0, 4.0, {"port": Point((1.0, 1.0))}),
    hand=HandState(True, 0.1, 0.2, 0.1, 0.2, 1.0, tremor_filter=False, added_tremor_mm=0.0),
    camera=CameraStamp("hardware", 5, 6),
)
WITHOUT_ARRIVAL = Capture(3, 1, None, camera=CameraStamp("ros", 5))


@pytest.mark.parametrize("capture", [FULL, WITHOUT_ARRIVAL, Capture(0, 0, None)])
@pytest.mark.parametrize("certainty", [None, CERTAIN, Certainty(0.5, None, 1.0)])
def test_messages_satisfy_their_schemas_with_and_without_optional_values(capture, certainty):
    step = make_step(faults=(Fault("source", "lost"),))
    step = replace(step, observation=replace(step.observation, certainty=certainty))
    topics = {topic.name: topic for topic in TOPICS}
    for name, message in entries(capture, step, image=GEOMETRY, utc_offset_ns=0):
        data = encode_message(message)
        assert invalid(name, json.loads(data), json.dumps(mcap_schema(topics[name], ()))) is None
        assert msgspec.json.decode(data, type=type(message)) == message


def test_images_are_base64_for_foxglove():
    schema = foxglove_schema(CompressedImage, "foxglove.CompressedImage")
    assert schema["properties"]["data"] == {"type": "string", "contentEncoding": "base64"}
    assert set(schema["properties"]) == {"timestamp", "frame_id", "data", "format"}
    assert set(foxglove_schema(ImageAnnotations, "x")["properties"]) == {"circles", "points", "texts"}


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
    assert (len(reader), reader.count()) == (3, (3, 1))
    assert reader.dropped_images == 1  # whatever was read without images


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
    with pytest.raises(BadInput, match="recording format '99'; this version reads 1, 2, 3, 4"):
        RunReader(tmp_path / "b.mcap")


def test_an_mcap_file_of_other_software_is_rejected(tmp_path):
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


def delete(path):
    path.unlink()


def move(path):
    path.rename(path.with_suffix(".moved"))


def replace_by_a_copy(path):
    data = path.read_bytes()
    path.unlink()
    path.write_bytes(data)


def truncate(path):
    os.truncate(path, path.stat().st_size // 2)


def empty(path):
    os.truncate(path, 0)


def append(path):
    with path.open("ab") as file:
        file.write(b"more")


@pytest.mark.parametrize("fits", [True, False])
def test_a_recorder_that_failed_writes_why_also_to_a_full_disk(tmp_path, monkeypatch, fits):
    path = tmp_path / "a.mcap"
    writer = RunWriter(path, INFO, GEOMETRY, ())
    for number in range(3):
        writer.write(Capture(number, number, IMAGE), make_step(stamp_ns=number))
    full_bytes, write = path.stat().st_size + (1000 if fits else 10), os.write

    def limited(descriptor, data):
        left = full_bytes - os.fstat(descriptor).st_size
        if left <= 0:
            raise OSError(28, "No space left on device")
        return write(descriptor, data[:left])

    monkeypatch.setattr(os, "write", limited)
    with pytest.raises(OSError, match="No space"):
        writer.write(Capture(3, 3, IMAGE), make_step(stamp_ns=3))
    writer.abandon("No space left on device")
    monkeypatch.undo()
    last = 2 if fits else 1
    failure = f"the recorder failed after step {last} (No space left on device); later steps are lost"
    assert RunReader(path).losses.failure == failure
    recovery = recover(path)
    assert (recovery.saved, recovery.steps, recovery.failure) == (path, last + 1, failure)
    assert RunReader(path).losses.failure == failure


@pytest.mark.parametrize("at_close", [False, True])
@pytest.mark.parametrize("change", [delete, move, replace_by_a_copy, truncate, empty, append])
def test_a_file_that_is_changed_while_it_is_written_is_not_complete(tmp_path, change, at_close):
    path = tmp_path / "a.mcap"
    writer = RunWriter(path, INFO, GEOMETRY, ())
    writer.write(Capture(0, 0, None), make_step())
    change(path)
    before = {file: file.read_bytes() for file in tmp_path.iterdir()}
    with pytest.raises(FileChanged):
        writer.close() if at_close else writer.write(Capture(1, 1, None), make_step(stamp_ns=1))
    assert not writer.is_complete
    writer.abandon()
    assert {file: file.read_bytes() for file in tmp_path.iterdir()} == before


@pytest.mark.parametrize("change", [delete, replace_by_a_copy, append])
def test_a_file_that_is_changed_while_it_is_compacted_is_not_replaced(tmp_path, change):
    path = tmp_path / "a.mcap"
    writer = RunWriter(path, INFO, GEOMETRY, ())
    for number in range(3):
        writer.write(Capture(number, number, None), make_step(stamp_ns=number))
    before, was_changed = [], []

    def progress(*_):
        if not was_changed:
            was_changed.append(change(path))
            before.extend(tmp_path.glob("*.mcap"))

    with pytest.raises((FileChanged, BadInput)):
        writer.close(progress)
    assert not writer.is_complete
    assert list(tmp_path.iterdir()) == before


def test_a_file_that_was_replaced_is_not_removed_with_an_empty_run(tmp_path):
    path = tmp_path / "a.mcap"
    writer = RunWriter(path, INFO, GEOMETRY, ())
    path.unlink()
    path.write_text("precious")
    writer.discard()
    assert path.read_text() == "precious"


def test_the_mcap_library_reads_a_journal_and_verifies_its_checksums(journal_file, tmp_path):
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(journal_file.read_bytes()[:-100_000])
    steps = RunReader(cut).count()[0]
    for path, expected in ((journal_file, 117), (cut, steps)):
        sequences = set()
        with path.open("rb") as file, suppress(EndOfFile):
            for _, channel, message in NonSeekingReader(file, validate_crcs=True).iter_messages(
                log_time_order=False
            ):
                sequences |= {message.sequence} if channel.topic == "/command" else set()
        assert len(sequences) == expected
    flipped = bytearray(cut.read_bytes())
    flipped[len(flipped) // 2] ^= 1
    with pytest.raises(ValueError, match="crc"):
        list(NonSeekingReader(BytesIO(flipped), validate_crcs=True).iter_messages(log_time_order=False))


def test_a_complete_journal_has_a_summary(journal_file):
    with journal_file.open("rb") as file:
        statistics = make_reader(file).get_summary().statistics
        assert statistics.message_count == sum(1 for _ in make_reader(file).iter_messages())
    assert statistics.message_end_time - statistics.message_start_time > 7e9


def test_a_pipe_and_a_folder_are_refused(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "folder").mkdir()
    for name in ("pipe", "folder"):
        for use in (RunReader, recover):
            with pytest.raises(BadInput, match=r"cannot be read \(not a regular file\)"):
                use(tmp_path / name)


def with_header(path, **fields):
    """Write a complete recording whose header has other fields, in format 2, so without a checksum."""
    header = header_record(msgspec.structs.replace(INFO, format="2")).metadata
    del header["sha256"]
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        writer.add_metadata("haptigraph", {**header, **fields})
        writer.finish()
    return path


@pytest.mark.parametrize(
    ("fields", "problem"),
    [
        ({}, None),
        ({"procedure": "P"}, "header is damaged (the SHA-256 of its procedure differs)"),
        ({"registration_sha256": "0"}, "header is damaged (the SHA-256 of its registration differs)"),
        ({"device_profile": "P"}, "header is damaged (the SHA-256 of its device_profile differs)"),
        ({"config": "{"}, "header cannot be read: configuration: Input data was truncated"),
        ({"rate_hz": "x"}, "header cannot be read: "),
        ({"format": "3"}, "header is damaged (its SHA-256 differs)"),
        ({"sha256": "0"}, "header is damaged (its SHA-256 differs)"),
    ],
)
def test_a_damaged_header_is_one_sentence(tmp_path, fields, problem):
    path = with_header(tmp_path / "a.mcap", **fields)
    if problem is None:
        assert RunReader(path).info.format == "2"
        return
    with pytest.raises(BadInput, match=re.escape(problem)):
        RunReader(path)


def test_a_configuration_of_another_shape_and_a_run_without_steps_are_one_sentence(tmp_path):
    reader = RunReader(with_header(tmp_path / "a.mcap", config='{"run": 7}'))
    with pytest.raises(BadInput, match="configuration in it cannot be read"):
        recorded_config(reader)
    with pytest.raises(BadInput, match="has no complete step to replay"):
        replay(tmp_path / "a.mcap")
    with pytest.raises(BadInput, match="contains no complete step"):
        recover(tmp_path / "a.mcap")


@pytest.mark.parametrize("data", [b'{"state": "\xff"}', b'{"state": 7}', b"{"])
def test_a_message_that_cannot_be_decoded_is_one_sentence(data):
    with pytest.raises(BadInput, match=r"a\.mcap, step 7: /state cannot be read: "):
        decode_message("/state", Message(1, 0, data, 0, 7), Path("a.mcap"))


CHILD = """
import sys
from haptigraph.assemble import build
from haptigraph.config import load_config
settings = (f"source.uri={sys.argv[1]}", "source.loop=true", f'recording.path="{sys.argv[2]}"')
for step in build(load_config(None, settings)).steps():
    print(step.stamp_ns, flush=True)
"""


@pytest.mark.realtime
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
    records = [(step.stamp_ns, capture.image is not None) for capture, step in reader.records()]
    read_back = [stamp_ns for stamp_ns, _ in records]
    assert read_back == stamps[: len(read_back)]
    newest_ns = max(stamp_ns for stamp_ns, has_image in records if has_image)
    assert stamps[-1] - newest_ns <= 1e9


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
