"""No damage goes unnoticed: what is read of a damaged recording is what was recorded, and every loss is reported."""

import random
from itertools import islice, pairwise

import pytest
from damages import DAMAGES, STEPS, content, make_files, truncate
from mcap.records import Message, Statistics

from haptigraph.analysis.metrics.trial import measure_recording
from haptigraph.errors import BadInput
from haptigraph.recording import compaction
from haptigraph.recording.journal import complete_records, not_being_written
from haptigraph.recording.reader import RunReader
from haptigraph.recording.recovery import recover
from haptigraph.recording.scan import Damage, scan
from haptigraph.recording.writer import RunWriter
from haptigraph.registration.loading import parse_registration


@pytest.fixture(scope="session")
def small(recording_file, tmp_path_factory):
    """A journal with small images, before it is finished, and its compacted file. Read-only."""
    folder = tmp_path_factory.mktemp("damage")
    make_files(recording_file, folder)
    return folder


@pytest.fixture(params=["journal", "whole"])
def kind(request):
    return request.param


def check_damaged(path, data, how, truth):
    """Check that reading and recovering tell nothing but the truth, and tell of every loss."""
    path.write_bytes(data)
    info, steps = truth
    saved = path.with_suffix(".recovered.mcap")
    saved.unlink(missing_ok=True)
    is_end_lost = how is truncate  # at the end of a record, an interrupted run looks the same
    try:
        reader, (found, read) = RunReader(path), content(path)
        assert found == info
        assert read == dict(islice(steps.items(), len(read)))
        assert len(read) == STEPS or not reader.is_whole
    except BadInput:
        pass
    try:
        recovery = recover(path)
    except BadInput as error:
        assert "header" in str(error) or how is truncate, error
        assert path.read_bytes() == data
        return "refused"
    found, left = content(recovery.saved or path)
    assert found == info
    assert left.items() <= steps.items()
    assert len(left) == recovery.steps
    missing = {number for first, last in recovery.missing for number in range(first, last + 1)}
    assert missing == set(range(max(left))) - left.keys() | {
        number for number in missing if number > max(left)
    }
    if len(left) < STEPS:
        assert recovery.damage or missing or is_end_lost
    if recovery.is_lossless:
        is_torn = any(damage.kind == "torn" for damage in recovery.damage)
        assert len(left) == STEPS or is_end_lost or (is_torn and len(left) >= STEPS - 2)
        return "complete"
    assert path.read_bytes() == data
    assert recovery.saved == saved
    assert RunReader(saved).losses == recovery.losses()
    return "saved"


def campaign(small, kind, tmp_path, count, seed):
    truth = content(small / "whole.mcap")
    whole = (small / f"{kind}.mcap").read_bytes()
    rng, outcomes = random.Random(seed), {"complete": 0, "saved": 0, "refused": 0}
    for _ in range(count):
        data, how = bytearray(whole), rng.choice(DAMAGES)
        how(data, rng)
        outcomes[check_damaged(tmp_path / "damaged.mcap", bytes(data), how, truth)] += 1
    return outcomes


def test_no_random_damage_goes_unnoticed(small, kind, tmp_path):
    outcomes = campaign(small, kind, tmp_path, 40, 1)
    assert outcomes["refused"] < 4
    assert outcomes["saved"] > 20


@pytest.mark.slow
@pytest.mark.timeout(1800)
def test_no_random_damage_goes_unnoticed_in_1000_files(small, kind, tmp_path):
    outcomes = campaign(small, kind, tmp_path, 1000, 2)
    assert outcomes["refused"] < 100, outcomes
    assert outcomes["saved"] > 500, outcomes


def chunks(path):
    """Return the places of the chunks with messages, by the number of their first step."""
    found = {}
    for piece in scan(path):
        sequences = [record.sequence for record in piece.records if isinstance(record, Message)]
        if sequences:
            found.setdefault(sequences[0], (piece.start, piece.end))
    return found


def test_one_flipped_bit_costs_one_step(small, tmp_path):
    truth, data = content(small / "whole.mcap"), bytearray((small / "journal.mcap").read_bytes())
    start, _ = chunks(small / "journal.mcap")[9]
    for at, bit in ((start, 1), (start + 1, 4), (start + 4, 1), (start + 20, 1), (start + 200, 8)):
        flipped, path = bytearray(data), tmp_path / f"{at}.mcap"
        flipped[at] ^= bit
        path.write_bytes(flipped)
        with pytest.raises(BadInput, match=rf"byte {start}: damaged \(.*; `haptigraph recover` saves"):
            content(path)
        recovery = recover(path)
        assert (recovery.missing, recovery.steps) == ([(9, 9)], STEPS - 1)
        assert path.read_bytes() == flipped
        assert content(recovery.saved)[1].keys() == truth[1].keys() - {9}
        assert RunReader(recovery.saved).losses.missing == "9"


def test_a_torn_last_record_is_left_out_and_reported(small, tmp_path):
    path, data = tmp_path / "torn.mcap", (small / "journal.mcap").read_bytes()
    start, _ = chunks(small / "journal.mcap")[STEPS - 1]
    path.write_bytes(data[: start + 1000])
    recovery = recover(path)
    assert (recovery.saved, recovery.is_lossless, recovery.left_out_bytes) == (path, True, 1000)
    assert [damage.kind for damage in recovery.damage] == ["torn"]
    assert len(content(path)[1]) == recovery.steps == STEPS - 1


def test_a_file_that_lacks_whole_steps_is_noticed_by_their_numbers(small, tmp_path):
    path, data = tmp_path / "gap.mcap", (small / "journal.mcap").read_bytes()
    places = chunks(small / "journal.mcap")
    path.write_bytes(data[: places[9][0]] + data[places[12][0] :])
    assert not any(isinstance(piece, Damage) for piece in scan(path))
    with pytest.raises(BadInput, match=r"damaged \(step 12 follows instead of 9\)"):
        content(path)
    assert recover(path).missing == [(9, 11)]


def test_a_whole_recording_with_a_damaged_length_does_not_read_short(small, tmp_path):
    path, data = tmp_path / "short.mcap", bytearray((small / "whole.mcap").read_bytes())
    start, _ = chunks(small / "whole.mcap")[0]
    data[start + 4] ^= 1
    path.write_bytes(data)
    with pytest.raises(BadInput, match=rf"byte {start}: damaged"):
        content(path)


def test_a_summary_that_counts_more_messages_is_damage(small, tmp_path):
    reader = RunReader(small / "whole.mcap")
    geometry = parse_registration(reader.info.registration, "x").image
    writer = RunWriter(tmp_path / "run.mcap", reader.info, geometry, ("theta_deg",))
    for capture, step in reader.records():
        writer.write(capture, step)
    writer._messages[1] += 1
    with pytest.raises(BadInput, match=r"damaged \((\d+) messages of \d+\)"):
        writer.close()
    assert not writer.is_complete


def test_the_second_copy_of_the_header_is_used_if_the_first_is_damaged(small, kind, tmp_path):
    path, data = tmp_path / "header.mcap", bytearray((small / f"{kind}.mcap").read_bytes())
    data[data.index(b"at_most = 5.5") + 10] ^= 1
    path.write_bytes(data)
    with pytest.raises(BadInput, match="header is damaged"):
        RunReader(path)
    recovery = recover(path)
    assert (recovery.steps, recovery.missing, recovery.is_lossless) == (STEPS, [], False)
    assert content(recovery.saved) == content(small / "whole.mcap")
    assert path.read_bytes() == data


def test_schemas_and_channels_are_found_in_the_summary_if_the_first_chunk_is_damaged(small, tmp_path):
    path, data = tmp_path / "definitions.mcap", bytearray((small / "whole.mcap").read_bytes())
    start, _ = chunks(small / "whole.mcap")[0]
    data[start + 100 : start + 100] = b"inserted"
    path.write_bytes(data)
    recovery = recover(path)
    assert (recovery.steps, recovery.missing) == (STEPS - 1, [(0, 0)])


def chunk_of_a_last_message(path):
    """The start of a chunk that begins with the last message of a step, and the step; None if there is none."""
    numbered = [
        (piece.start, numbers)
        for piece in scan(path)
        if (numbers := [record.sequence for record in piece.records if isinstance(record, Message)])
    ]
    found = (
        (start, numbers[0])
        for (_, before), (start, numbers) in pairwise(numbered)
        if numbers[0] == before[-1] and numbers.count(numbers[0]) == 1
    )
    return next(found, None)


def test_a_step_whose_last_message_is_lost_counts_as_lost(small, tmp_path, monkeypatch):
    whole, path = small / "whole.mcap", tmp_path / "timing.mcap"
    for chunk_bytes in range(20_000, 60_000, 500):  # until a chunk ends just before a last message
        monkeypatch.setattr(compaction, "CHUNK_BYTES", chunk_bytes)
        compaction.write_compacted(path, (record for _, record in complete_records(whole)))
        if (place := chunk_of_a_last_message(path)) is not None:
            break
    start, first = place
    data = bytearray(path.read_bytes())
    data[start + 100] ^= 1
    path.write_bytes(data)
    recovery = recover(path)
    assert recovery.missing[0][0] == first
    left, truth = content(recovery.saved)[1], content(whole)[1]
    assert left.items() <= truth.items()


def test_totals_of_a_damaged_summary_are_not_believed(small, tmp_path):
    path, data = tmp_path / "totals.mcap", bytearray((small / "whole.mcap").read_bytes())
    places = chunks(small / "whole.mcap")
    data[places[max(places)][0] + 60] ^= 1
    (end,) = [piece.end for piece in scan(small / "whole.mcap") if isinstance(piece.records[0], Statistics)]
    data[end - 3] = 200  # millions of messages
    path.write_bytes(data)
    recovery = recover(path)
    assert recovery.missing == []
    assert [damage.kind for damage in recovery.damage] == ["lost", "summary"]
    data[end - 3] = 0
    path.write_bytes(data)
    recovery.saved.unlink()
    assert recover(path).missing == [(recovery.steps, STEPS - 1)]


def test_a_damaged_summary_is_made_anew_in_place(small, tmp_path):
    path, data = tmp_path / "summary.mcap", bytearray((small / "whole.mcap").read_bytes())
    data[-60] ^= 1
    path.write_bytes(data)
    with pytest.raises(BadInput, match="damaged"):
        content(path)
    recovery = recover(path)
    assert (recovery.saved, recovery.is_lossless, recovery.steps) == (path, True, STEPS)
    assert content(path) == content(small / "whole.mcap")


def test_a_damaged_recovered_recording_is_recovered_again(small, tmp_path):
    path, data = tmp_path / "run.mcap", bytearray((small / "journal.mcap").read_bytes())
    data[chunks(small / "journal.mcap")[3][0] + 60] ^= 1
    path.write_bytes(data)
    once = recover(path).saved
    again = recover(once)
    assert (again.saved, again.missing, again.is_lossless) == (None, [(3, 3)], False)
    once.write_bytes(once.read_bytes()[:-9])
    twice = recover(once).saved
    assert content(twice)[1].keys() == set(range(STEPS)) - {3}
    assert RunReader(twice).losses.missing == "3"


def test_unfinished_copies_are_removed_once_the_recording_is_complete(small, tmp_path):
    path = tmp_path / "run.mcap"
    path.write_bytes((small / "journal.mcap").read_bytes())
    begun, empty, precious = (tmp_path / f"run.mcap.part{number}" for number in ("", 1, 2))
    begun.write_bytes((small / "whole.mcap").read_bytes()[:30_000])
    empty.write_bytes(b"")
    precious.write_text("precious")
    (tmp_path / "run.mcap.partly").write_text("of another name")
    recovery = recover(path)
    assert (recovery.removed, recovery.left) == ([begun, empty], [precious])
    assert precious.read_text() == "precious"
    assert sorted(tmp_path.iterdir()) == [path, precious, tmp_path / "run.mcap.partly"]
    begun.write_bytes((small / "whole.mcap").read_bytes()[:30_000])
    assert recover(path).removed == [begun]


def test_an_unfinished_copy_is_kept_beside_a_damaged_recording_or_while_it_is_written(small, tmp_path):
    path, copy = tmp_path / "run.mcap", tmp_path / "run.mcap.part"
    copy.write_bytes((small / "whole.mcap").read_bytes()[:30_000])
    path.write_bytes((small / "journal.mcap").read_bytes())
    with not_being_written(copy):
        assert (recover(path).left, copy.exists()) == ([copy], True)
    data = bytearray((small / "journal.mcap").read_bytes())
    data[chunks(small / "journal.mcap")[9][0]] ^= 1
    path.write_bytes(data)
    assert (recover(path).left, copy.exists()) == ([copy], True)


def test_a_trial_with_missing_steps_is_refused(small, tmp_path):
    path, data = tmp_path / "run.mcap", bytearray((small / "journal.mcap").read_bytes())
    data[chunks(small / "journal.mcap")[3][0] + 60] ^= 1
    path.write_bytes(data)
    with pytest.raises(BadInput, match="was recovered from a damaged recording and lacks steps"):
        measure_recording(recover(path).saved)
