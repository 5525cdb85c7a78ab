"""A recording as a sequence of steps, by number and by time."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from haptigraph.errors import BadInput
from haptigraph.recording.reader import RunReader


@pytest.fixture(scope="module")
def run(recording_file):
    return RunReader(recording_file)


@pytest.fixture(scope="module")
def steps(run):
    return [step for _, step in run.records(images=())]


BOUND = st.none() | st.integers(-140, 140)


def test_a_run_is_the_sequence_of_its_steps(run, steps):
    assert len(run) == len(steps) > 100
    assert list(run) == steps
    assert steps[7] in run
    for number in (0, 60, len(steps) - 1, -1, -len(steps)):
        assert run[number] == steps[number]


@settings(max_examples=15)
@given(bounds=st.tuples(BOUND, BOUND, st.sampled_from([None, 1, 2, 7, -1, -3])))
def test_slices_are_those_of_a_list(run, steps, bounds):
    assert run[slice(*bounds)] == steps[slice(*bounds)]


def test_a_number_that_does_not_exist_is_an_index_error(run, steps):
    for number in (len(steps), -len(steps) - 1):
        with pytest.raises(
            IndexError, match=rf"quick.mcap has no step {number}; valid: 0 to {len(steps) - 1}"
        ):
            _ = run[number]


def test_steps_by_time_count_from_the_first(run, steps):
    start_ns = steps[0].stamp_ns
    assert run.at_s[0] == steps[0]
    assert run.at_s[(steps[40].stamp_ns - start_ns) / 1e9] == steps[40]
    between = [step for step in steps if 2.5 <= (step.stamp_ns - start_ns) / 1e9 < 4]
    assert run.at_s[2.5:4] == between != []
    with pytest.raises(IndexError, match="nothing at 99 s; valid: 0 to 7"):
        _ = run.at_s[99]


def test_a_capture_has_its_image_and_bytes(run):
    for number, (capture, _) in enumerate(run.records(images={0, 50})):
        if number in (0, 50):
            found = run.capture(number)
            assert np.array_equal(found.image, capture.image)
            assert (found.index, found.encoded) == (capture.index, capture.encoded)
    assert run.capture(-1).image is None  # the end of the source


def test_an_interrupted_run_is_a_sequence_too(journal_file, tmp_path):
    torn = tmp_path / "torn.mcap"
    torn.write_bytes(journal_file.read_bytes()[:-2000])
    run = RunReader(torn)
    assert 0 < len(run) < len(RunReader(journal_file))
    assert run[-1] == list(run)[-1]


def test_a_file_that_changed_under_the_index_is_reported(recording_file, journal_file, tmp_path):
    path = tmp_path / "run.mcap"
    path.write_bytes(journal_file.read_bytes())
    run = RunReader(path)
    assert len(run)
    path.write_bytes(recording_file.read_bytes())
    for read in (lambda: run[60], lambda: run[20:60], lambda: run.capture(60)):
        with pytest.raises(BadInput, match=r"run\.mcap"):
            read()


def test_it_closes_what_images_of_a_stored_video_open(recording_file):
    with RunReader(recording_file) as run:
        run.close()
        assert run.capture(3).image is not None
