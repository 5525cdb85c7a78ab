"""The export for Foxglove, read with MCAP's library and Foxglove's schemas."""

import math
import sys

import pytest
from mcap.reader import make_reader

from haptigraph.analysis.exporting.columns import RunTable
from haptigraph.analysis.exporting.foxglove_mcap import run_foxglove
from haptigraph.errors import MissingExtra
from haptigraph.messages import Fault
from haptigraph.recording.entries import entries

decoding = pytest.importorskip("mcap_protobuf.decoder")
pytest.importorskip("foxglove_schemas_protobuf")


@pytest.fixture(scope="module")
def exported(recording, tmp_path_factory):
    path = tmp_path_factory.mktemp("foxglove") / "run.mcap"
    run_foxglove(recording, path, None, "run")
    return path


@pytest.fixture(scope="module")
def messages(exported):
    """(log time, message) by topic."""
    found = {}
    with exported.open("rb") as file:
        reader = make_reader(file, decoder_factories=[decoding.DecoderFactory()])
        for schema, channel, message, decoded in reader.iter_decoded_messages():
            assert schema.encoding == channel.message_encoding == "protobuf"
            found.setdefault(channel.topic, []).append((message.log_time, decoded))
    return found


@pytest.fixture(scope="module")
def table(recording):
    return RunTable(recording, "run")


def stamp(message):
    return message.timestamp.seconds * 10**9 + message.timestamp.nanos


def test_every_field_of_every_step_is_that_of_the_recording(messages, table):
    rows = list(table.rows())
    assert len(messages["/step"]) == len(rows)
    columns = [column for column in table.columns if column.name != "utc"]
    nans = 0
    for (log_time, message), row in zip(messages["/step"], rows, strict=True):
        assert log_time == row.step.stamp_ns + table.reader.info.utc_offset_ns
        assert [field.name for field in message.DESCRIPTOR.fields] == [column.name for column in columns]
        for column in columns:
            value, found = column.value(row), getattr(message, column.name)
            if value is None and column.kind == "number":
                assert math.isnan(found), column.name
                nans += 1
            elif value is None:
                assert not message.HasField(column.name), column.name
            else:
                assert (list(found) if column.kind == "texts" else found) == value, column.name
    assert nans > len(rows)


def test_images_are_the_very_bytes_that_perception_consumed(messages, table):
    captures = [capture for capture, _ in table.reader.records() if capture.image is not None]
    assert len(captures) > 50
    images = messages["/camera/image"]
    assert [image.data for _, image in images] == [capture.encoded for capture in captures]
    assert {image.format for _, image in images} == {"jpeg"}
    offset_ns = table.reader.info.utc_offset_ns
    assert [stamp(image) for _, image in images] == [capture.stamp_ns + offset_ns for capture in captures]


def test_annotations_are_those_of_the_recording(messages, table):
    found = [message for _, message in messages["/camera/annotations"]]
    expected = [
        dict(entries(capture, step, image=table.registration.image, utc_offset_ns=0))["/camera/annotations"]
        for capture, step in table.reader.records()
    ]
    assert len(found) == len(expected)
    for one, other in zip(found, expected, strict=True):
        assert [(circle.position.x, circle.position.y, circle.diameter) for circle in one.circles] == [
            (circle.position.x, circle.position.y, circle.diameter) for circle in other.circles
        ]
        points = [[(point.x, point.y) for point in line.points] for line in one.points]
        assert points == [[(point.x, point.y) for point in line.points] for line in other.points]
        assert [text.text for text in one.texts] == [text.text for text in other.texts]
    assert any(one.circles for one in found)


def test_faults_are_logged(recording, tmp_path, monkeypatch):
    from msgspec.structs import replace

    def with_fault(self, **options):
        for number, capture, step in before(self, **options):
            observation = replace(step.observation, faults=(Fault("source", "stale image"),))
            yield number, replace(capture, image=None, encoded=None), replace(step, observation=observation)

    reader = type(RunTable(recording, "run").reader)
    before = reader.numbered_records
    monkeypatch.setattr(reader, "numbered_records", with_fault)
    run_foxglove(recording, tmp_path / "run.mcap", None, "run")
    with (tmp_path / "run.mcap").open("rb") as file:
        decoded = make_reader(file, decoder_factories=[decoding.DecoderFactory()]).iter_decoded_messages()
        logged = [
            (channel.topic, message.message) for _, channel, _, message in decoded if channel.topic == "/log"
        ]
        file.seek(0)
        topics = {channel.topic for channel in make_reader(file).get_summary().channels.values()}
    assert set(logged) == {("/log", "stale image")}
    assert "/camera/image" not in topics


def test_foxgloves_schemas_are_its_own(exported):
    with exported.open("rb") as file:
        summary = make_reader(file).get_summary()
    names = {channel.topic: summary.schemas[channel.schema_id].name for channel in summary.channels.values()}
    assert names == {
        "/camera/image": "foxglove.CompressedImage",
        "/camera/annotations": "foxglove.ImageAnnotations",
        "/step": "haptigraph.Step",
    }


@pytest.mark.parametrize("module", ["mcap_protobuf.writer", "foxglove_schemas_protobuf"])
def test_without_the_libraries_the_extra_is_named(module, recording, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(MissingExtra, match=r"haptigraph\[foxglove\]"):
        run_foxglove(recording, tmp_path / "run.mcap", None, "run")
