"""Random access to single steps of a recording."""

import pytest

from haptigraph.errors import BadInput
from haptigraph.recording.reader import RunReader


@pytest.fixture(params=["compacted", "journal"])
def path(request, recording_file, journal_file):
    return recording_file if request.param == "compacted" else journal_file


def test_random_access_gives_the_same_steps_as_reading_in_order(path):
    reader = RunReader(path)
    records = list(reader.records())
    places = list(reader.places())
    assert [step for _, step in places] == [step for _, step in records]
    for number in (*range(0, len(records), 7), len(records) - 1):
        capture, step = RunReader(path).record_at(places[number][0])
        assert step == records[number][1]
        assert capture.encoded == records[number][0].encoded
        assert (capture.stamp_ns, capture.truth) == (records[number][0].stamp_ns, records[number][0].truth)


def test_a_truncated_recording_gives_its_last_complete_step(journal_file, tmp_path):
    truncated = tmp_path / "truncated.mcap"
    data = journal_file.read_bytes()
    truncated.write_bytes(data[: len(data) // 2 + 11])
    *_, (place, last) = RunReader(truncated).places()
    assert RunReader(truncated).record_at(place)[1] == last


def test_a_step_of_a_changed_file_is_an_error(recording_file, journal_file, tmp_path):
    *_, (place, _) = RunReader(journal_file).places()
    short = tmp_path / "short.mcap"
    short.write_bytes(journal_file.read_bytes()[: place.start])
    with pytest.raises(BadInput, match="has changed; open the recording again"):
        RunReader(short).record_at(place)
    with pytest.raises(BadInput, match=r"damaged|has changed"):
        RunReader(recording_file).record_at(place._replace(start=place.start // 3 + 1, end=place.end // 3))
