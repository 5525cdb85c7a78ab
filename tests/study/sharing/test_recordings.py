from datetime import datetime
from hashlib import sha256

import msgspec
import pytest
from msgspec.structs import replace
from paths import DATA, GOLDEN

from haptigraph.recording.reader import RunReader
from haptigraph.recording.schema import FORMAT
from haptigraph.recording.writer import RunWriter
from haptigraph.registration.loading import parse_registration
from haptigraph.study.sharing.recordings import copy_recording

PERSON = {"enrolled_utc": "2026-11-20T09:00:00+00:00"}
OLD = next((DATA / "v0_1").rglob("*.mcap"))


def rewritten(source, target, edit, dropped=()):
    """Write a recording again with another header."""
    reader = RunReader(source)
    image = parse_registration(reader.info.registration, "registration").image
    writer = RunWriter(target, edit(reader.info), image, ())
    for number, (capture, step) in enumerate(reader.records()):
        writer.write(capture, step, dropped=number in dropped)
    writer.close()
    return target


@pytest.mark.parametrize("source", [GOLDEN / "align_then_approach.mcap", OLD], ids=["new", "old"])
def test_a_copy_has_the_same_steps_and_images(source, tmp_path):
    assert copy_recording(source, tmp_path / "new" / "copy.mcap", "KXQV0142", PERSON)
    copy, original = RunReader(tmp_path / "new" / "copy.mcap"), RunReader(source)
    pairs = zip(copy.records(), original.records(), strict=True)
    for (capture, step), (other, other_step) in pairs:
        assert step == other_step and capture.encoded == other.encoded
        assert repr(replace(other, camera=None, image=None)) == repr(replace(capture, image=None))
    assert (copy.info.format, copy.info.participant) == (FORMAT, "KXQV0142")


def test_a_copy_names_no_person_folder_or_date(tmp_path):
    config = {
        "trial": {"participant": "P01"},
        "run": {"procedure": "/home/anna/own.toml"},
        "names": [1, "/home/anna/x"],
    }
    config |= {"recording": {"path": "anna\\recordings\\P01\\t.mcap"}, "haptics": {"device": "none"}}
    edit = lambda info: replace(  # noqa: E731
        info,
        participant="P01",
        source="/home/anna/eye.mp4",
        started_utc="2026-11-21T10:00:00+00:00",
        config=msgspec.json.encode(config).decode(),
        device_profile="by = 'anna'",
        device_profile_sha256=sha256(b"by = 'anna'").hexdigest(),
    )
    source = rewritten(GOLDEN / "align_then_approach.mcap", tmp_path / "one.mcap", edit)
    assert copy_recording(source, tmp_path / "copy.mcap", "KXQV0142", PERSON)
    info, before = RunReader(tmp_path / "copy.mcap").info, RunReader(source).info
    assert not [
        word for word in ("P01", "anna", "home", "2026-11-2") if word in repr(replace(info, registration=""))
    ]
    assert (info.source, info.started_utc) == ("eye.mp4", "2000-01-02T01:00:00.000000+00:00")
    shift_s = (
        datetime.fromisoformat(before.started_utc) - datetime.fromisoformat(info.started_utc)
    ).total_seconds()
    assert before.utc_offset_ns - info.utc_offset_ns == shift_s * 1e9
    assert '"procedure":"own.toml"' in info.config and '"participant":"KXQV0142"' in info.config


def test_a_recording_that_lacks_images_is_not_copied(tmp_path):
    source = rewritten(GOLDEN / "align_then_approach.mcap", tmp_path / "one.mcap", lambda info: info, {3})
    assert not copy_recording(source, tmp_path / "copy.mcap", "KXQV0142", PERSON)
    assert not (tmp_path / "copy.mcap").exists()
