import os
import re

import pytest
from mcap.records import Message
from mcap.writer import CompressionType, Writer

from haptigraph.errors import BadInput
from haptigraph.recording.compaction import compact
from haptigraph.recording.journal import (
    Journal,
    complete_records,
    is_being_written,
    is_whole,
    records_between,
)
from haptigraph.recording.recovery import recover
from haptigraph.recording.scan import MAGIC


def test_a_journal_is_on_disk_before_it_is_closed(tmp_path):
    file = tmp_path / "j"
    journal = Journal(os.open(file, os.O_WRONLY | os.O_CREAT))
    journal.write(b"abc")
    assert file.read_bytes() == b"abc"
    journal.write(b"de")
    assert journal.tell() == 5
    journal.close()
    journal.close()
    assert journal.closed
    with pytest.raises(ValueError, match=r"^write to a closed journal$"):
        journal.write(b"d")


def test_a_write_that_the_system_shortens_is_continued(tmp_path, monkeypatch):
    write, sizes = os.write, []

    def short_write(descriptor, data):
        sizes.append(len(data))
        return write(descriptor, data[:3])

    monkeypatch.setattr(os, "write", short_write)
    journal = Journal(os.open(tmp_path / "j", os.O_WRONLY | os.O_CREAT))
    assert journal.write(b"0123456789") == 10
    assert sizes == [10, 7, 4, 1]
    assert (journal.tell(), (tmp_path / "j").read_bytes()) == (10, b"0123456789")
    journal.close()


def messages(path) -> int:
    return sum(isinstance(record, Message) for _, record in complete_records(path))


def test_truncation_at_any_byte_keeps_all_records_before_it(journal_file, tmp_path):
    data = journal_file.read_bytes()
    total = messages(journal_file)
    before = -1
    for size in range(8, len(data), max(1, len(data) // 59)):
        cut = tmp_path / "cut.mcap"
        cut.write_bytes(data[:size])
        found = messages(cut)
        assert before <= found <= total
        before = max(before, found)
    assert before > 0.9 * total


def test_truncation_at_the_end_of_a_record_keeps_that_record(journal_file, tmp_path):
    data = journal_file.read_bytes()
    ends = sorted({end for end, _ in complete_records(journal_file)})
    cut = tmp_path / "cut.mcap"
    for number in (1, 2, len(ends) // 2, len(ends) - 1, len(ends)):
        for size, whole in ((ends[number - 1], number), (ends[number - 1] - 1, number - 1)):
            cut.write_bytes(data[:size])
            assert sorted({end for end, _ in complete_records(cut)}) == ends[:whole]


def test_a_truncated_file_is_compacted_to_a_complete_one(journal_file, tmp_path):
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(journal_file.read_bytes()[:-100_000])
    expected = messages(cut)
    assert not is_whole(cut)
    assert compact(cut) == expected
    assert is_whole(cut)
    assert messages(cut) == expected
    assert not (tmp_path / "cut.mcap.part").exists()


def test_compacting_again_keeps_all_messages(journal_file, tmp_path):
    copy = tmp_path / "copy.mcap"
    copy.write_bytes(journal_file.read_bytes())
    once = compact(copy)
    assert compact(copy) == once
    assert copy.stat().st_size < journal_file.stat().st_size


@pytest.mark.parametrize("content", [b"", b"hello", b"\x00" * 1000])
def test_other_files_are_rejected(tmp_path, content):
    file = tmp_path / "x.mcap"
    file.write_bytes(content)
    with pytest.raises(BadInput, match=r"x\.mcap: not a recording \(an MCAP file begins otherwise\)"):
        list(complete_records(file))
    assert not is_whole(file)


def test_a_missing_file_is_an_error(tmp_path):
    with pytest.raises(BadInput, match=r"gone\.mcap: cannot be read"):
        list(complete_records(tmp_path / "gone.mcap"))


def test_damage_in_the_middle_is_reported_with_its_offset(journal_file, tmp_path):
    data = bytearray(journal_file.read_bytes())
    data[8 + 9 : 8 + 60] = b"\xff" * 51
    file = tmp_path / "damaged.mcap"
    file.write_bytes(data)
    with pytest.raises(BadInput, match=r"byte \d+: damaged"):
        list(complete_records(file))


def test_a_journal_that_is_still_being_written_is_not_recovered(journal_file, tmp_path):
    file = tmp_path / "live.mcap"
    journal = Journal(os.open(file, os.O_WRONLY | os.O_CREAT))
    journal.write(journal_file.read_bytes()[:-100_000])
    before = file.read_bytes()
    assert is_being_written(file)
    with pytest.raises(BadInput, match=r"live\.mcap: is still being written; end that run first"):
        recover(file)
    assert file.read_bytes() == before
    journal.close()
    assert not is_being_written(file)
    assert recover(file).saved == file
    assert recover(file).saved is None
    assert is_whole(file)


def test_an_existing_part_file_is_never_overwritten(journal_file, tmp_path):
    file, precious = tmp_path / "run.mcap", tmp_path / "run.mcap.part"
    file.write_bytes(journal_file.read_bytes())
    precious.write_text("precious")
    compact(file)
    assert precious.read_text() == "precious"
    assert sorted(tmp_path.iterdir()) == [file, precious]


@pytest.mark.parametrize("error", [KeyboardInterrupt, OSError])
def test_an_interrupted_compaction_leaves_the_file_unchanged(journal_file, tmp_path, error):
    file = tmp_path / "run.mcap"
    file.write_bytes(journal_file.read_bytes())

    def interrupt(what, done, size):
        raise error(28, "No space left on device")

    with pytest.raises(error) as raised:
        compact(file, interrupt)
    assert list(tmp_path.iterdir()) == [file]
    assert file.read_bytes() == journal_file.read_bytes()
    if error is OSError:
        assert raised.value.filename == str(tmp_path / "run.mcap.part")


@pytest.mark.parametrize("share", [0.2, 0.5])
@pytest.mark.parametrize("damage", [b"\xff" * 40, b"\x01", b"\x80"])
def test_a_damaged_chunk_is_reported(recording_file, tmp_path, share, damage):
    data = bytearray(recording_file.read_bytes())
    start = int(share * len(data))
    for place, flipped in enumerate(damage, start):
        data[place] ^= flipped
    file = tmp_path / "damaged.mcap"
    file.write_bytes(data)
    for use in (messages, compact):
        with pytest.raises(BadInput, match=r"damaged\.mcap, byte \d+: damaged \("):
            use(file)
    assert list(tmp_path.iterdir()) == [file]


@pytest.mark.parametrize(
    ("content", "whole"), [(MAGIC, False), (b"\0" * 7 + MAGIC, False), (MAGIC + MAGIC, True)]
)
def test_a_whole_recording_begins_and_ends_with_a_signature(tmp_path, content, whole):
    file = tmp_path / "short.mcap"
    file.write_bytes(content)
    assert is_whole(file) is whole


def test_records_between_two_offsets_are_those_of_the_whole_file(journal_file):
    records = list(complete_records(journal_file))
    ends = sorted({end for end, _ in records})
    start, end = ends[5], ends[8]
    assert list(records_between(journal_file, start, end)) == [
        (at, record) for at, record in records if start < at <= end
    ]


def test_records_between_offsets_of_a_missing_file_are_an_error(tmp_path):
    with pytest.raises(BadInput, match=r"gone\.mcap: cannot be read \(No such file"):
        list(records_between(tmp_path / "gone.mcap", 8, 100))


@pytest.fixture
def flipped_file(tmp_path):
    """A recording whose chunk is not compressed, with a flipped bit in a message: only its CRC notices."""
    file = tmp_path / "flipped.mcap"
    with file.open("wb") as stream:
        writer = Writer(stream, compression=CompressionType.NONE)
        writer.start()
        channel = writer.register_channel("/observation", "json", writer.register_schema("any", "", b""))
        writer.add_message(channel, 0, b"a unique message", 0)
        writer.finish()
    data = bytearray(file.read_bytes())
    data[data.index(b"unique")] ^= 1
    file.write_bytes(data)
    return file


def test_a_flipped_bit_in_a_message_is_damage(flipped_file):
    read = []
    with pytest.raises(BadInput, match=r"flipped\.mcap, byte \d+: damaged \(crc"):
        read += (end for end, _ in complete_records(flipped_file))
    size = flipped_file.stat().st_size
    with pytest.raises(BadInput, match=r"flipped\.mcap, byte \d+: damaged \(crc") as refused:
        list(records_between(flipped_file, len(MAGIC), size))
    assert len(MAGIC) < int(re.search(r"byte (\d+)", str(refused.value))[1]) < size
