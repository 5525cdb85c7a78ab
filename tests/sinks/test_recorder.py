import threading
from collections import Counter, deque
from functools import partial

import numpy as np
import pytest
from helpers import every_moment, make_step

from haptigraph.errors import BadInput
from haptigraph.messages import Capture, Fault
from haptigraph.recording.journal import FileChanged
from haptigraph.run_report import RunReport
from haptigraph.sinks import recorder as recorder_module
from haptigraph.sinks.recorder import Recorder

IMAGE = np.zeros((2, 2), np.uint8)


class Writer:
    """A writer that can be blocked or broken."""

    path, is_complete = "run.mcap", False

    def __init__(self):
        self.written, self.gate, self.error = [], threading.Event(), None
        self.problems = []
        self.closed = self.abandoned = 0
        self.gate.set()

    def write(self, capture, step, *, dropped):
        self.gate.wait(10)
        if self.error is not None:
            raise self.error
        self.written.append((capture, step, dropped))

    def take_problems(self):
        problems, self.problems = self.problems, []
        return problems

    @property
    def steps(self):
        return len(self.written)

    def close(self, progress):
        self.closed += 1

    def abandon(self, reason):
        self.abandoned += 1


@pytest.fixture
def writer():
    return Writer()


def write(recorder, count):
    for number in range(count):
        recorder.write(Capture(number, number, IMAGE), make_step(stamp_ns=number))


def test_all_steps_are_written_in_order(writer):
    recorder = Recorder(writer, waits=True)
    write(recorder, 200)
    recorder.close()
    recorder.close()
    assert [step.stamp_ns for _, step, _ in writer.written] == list(range(200))
    assert (recorder.dropped, writer.closed) == (0, 1)


def test_a_slow_disk_drops_images_but_never_delays_the_loop(writer):
    writer.gate.clear()
    recorder = Recorder(writer, waits=False)
    write(recorder, 100)  # returns though nothing is written
    writer.gate.set()
    recorder.close()
    assert recorder.dropped == 100 - recorder_module.MAX_IMAGES
    assert len(writer.written) == 100  # every step, some without image
    kept = [not dropped for _, _, dropped in writer.written]
    assert kept == [True] * recorder_module.MAX_IMAGES + [False] * recorder.dropped
    assert all((capture.image is None) == dropped for capture, _, dropped in writer.written)


def test_a_stalled_disk_eventually_drops_whole_steps(writer, monkeypatch):
    monkeypatch.setattr(recorder_module, "MAX_STEPS", 10)
    writer.gate.clear()
    recorder = Recorder(writer, waits=False)
    write(recorder, 50)
    writer.gate.set()
    recorder.close()
    lost = sum(dropped for _, _, dropped in writer.written)
    assert len(writer.written) - lost + recorder.dropped == 50
    assert len(writer.written) <= 12


def test_a_full_disk_is_reported_once_and_the_file_can_be_recovered(writer):
    recorder = Recorder(writer, waits=True)
    write(recorder, 3)
    writer.error = OSError(28, "No space left on device")
    write(recorder, 30)
    recorder.close()
    (fault,) = recorder.take_faults()
    assert (
        fault.message
        == "run.mcap is incomplete (No space left on device); later steps are lost, earlier ones can be recovered"
    )
    assert (writer.abandoned, writer.closed) == (1, 0)
    assert recorder.dropped + len(writer.written) == 33


def test_any_other_error_is_reported_and_blocks_nothing(writer):
    writer.error = ValueError("odd image")
    recorder = Recorder(writer, waits=True)
    write(recorder, 100)
    recorder.close()
    assert "incomplete (ValueError: odd image)" in recorder.take_faults()[0].message


def test_a_disk_that_is_full_at_the_end_is_reported(writer):
    def full(progress):
        raise OSError(28, "No space left on device")

    writer.close = full
    recorder = Recorder(writer, waits=True)
    recorder.close()
    assert "No space left" in recorder.take_faults()[0].message


def test_queued_steps_are_counted_once_when_the_disk_fails(writer):
    writer.gate.clear()
    recorder = Recorder(writer, waits=False)
    write(recorder, 100)  # most without their image
    writer.error = OSError(28, "No space left on device")
    writer.gate.set()
    recorder.close()
    assert recorder.dropped + len(writer.written) == 100


def test_a_disk_that_is_full_while_compacting_loses_nothing(writer):
    def full(progress):
        writer.is_complete = True
        raise OSError(28, "No space left on device")

    writer.close = full
    recorder = Recorder(writer, waits=True)
    recorder.close()
    (fault,) = recorder.take_faults()
    assert fault.message == "run.mcap is complete but not compacted (No space left on device)"


def test_a_file_that_was_deleted_meanwhile_is_incomplete_and_nothing_in_it_counts_as_recorded(writer):
    recorder = Recorder(writer, waits=True)
    write(recorder, 3)
    writer.error = FileChanged("it was deleted")
    write(recorder, 4)
    recorder.close()
    (fault,) = recorder.take_faults()
    assert fault.message == "run.mcap is incomplete (it was deleted)"
    assert (recorder.dropped, writer.closed) == (7, 0)


def test_a_recording_that_turns_out_damaged_is_not_reported_as_complete(writer):
    def damaged(progress):
        raise BadInput("damaged (crc of a chunk differs)", "run.mcap", "byte 7")

    writer.close = damaged
    recorder = Recorder(writer, waits=True)
    recorder.close()
    (fault,) = recorder.take_faults()
    assert fault.message == "run.mcap is incomplete (damaged (crc of a chunk differs))"


def test_a_reason_why_images_are_not_stored_as_their_video_is_a_fault_of_a_complete_recording(writer):
    recorder = Recorder(writer, waits=True)
    writer.problems = ["clip.mp4 is not stored in the recording, but each image as PNG: it was changed"]
    write(recorder, 2)
    recorder.close()
    (fault,) = recorder.take_faults()
    assert (fault.where, fault.message[:8], len(writer.written)) == ("recorder", "clip.mp4", 2)
    assert RunReport(faults=Counter({f"recorder: {fault.message}": 1})).incomplete == ""


def test_a_fault_that_comes_while_others_are_taken_is_not_lost(writer):
    recorder, late = Recorder(writer, waits=True), Fault("recorder", "late")

    class Faults(deque):
        def popleft(self):
            if late not in taken:
                taken.append(late)
                self.append(late)
            return super().popleft()

    taken = []
    recorder._faults = Faults([Fault("recorder", "early")])
    found = recorder.take_faults() + recorder.take_faults()
    assert [fault.message for fault in found] == ["early", "late"]
    recorder.close()


@pytest.mark.parametrize("waits", [True, False])
def test_ctrl_c_at_any_moment_does_not_block_closing(waits):
    for pressing_ctrl_c in every_moment():
        writer = Writer()
        recorder = Recorder(writer, waits=waits)
        write(recorder, 1)
        pressing_ctrl_c(partial(write, recorder, 1))
        recorder.close()
        assert writer.closed == 1
        assert len(writer.written) >= 1
