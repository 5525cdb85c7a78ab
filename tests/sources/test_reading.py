import threading
from contextlib import closing
from functools import partial

import numpy as np
import pytest
from helpers import every_moment

from haptigraph.errors import BadInput, EndOfSource
from haptigraph.messages import Capture
from haptigraph.sources.reading import DEPTH, ReadAhead, read_images
from haptigraph.stages import Source

IMAGE = np.zeros((2, 2), np.uint8)


class Counting(Source):
    rate_hz, is_live, registration, notes = 30.0, False, "text", ("a note",)

    def __init__(self, count, error=None):
        self.count, self.error, self.reads, self.closed = count, error or EndOfSource(), 0, 0
        self.threads = set()

    def read(self, timeout_s):
        self.threads.add(threading.current_thread().name)
        self.reads += 1
        if self.reads > self.count:
            raise self.error
        return Capture(self.reads - 1, self.reads, IMAGE)

    def close(self):
        self.closed += 1


def test_captures_come_in_order_with_members_and_end_of_the_source():
    inner = Counting(50)
    source = ReadAhead(inner, waits=True)
    assert (source.rate_hz, source.registration, source.notes) == (30.0, "text", ("a note",))
    assert [source.read(1.0).index for _ in range(50)] == list(range(50))
    for _ in range(2):
        with pytest.raises(EndOfSource):
            source.read(1.0)
    source.close()
    assert inner.closed == 1
    assert inner.threads == {"haptigraph-read-ahead"}


def test_errors_are_raised_in_the_reader():
    source = ReadAhead(Counting(1, BadInput("broken image")), waits=True)
    source.read(1.0)
    with pytest.raises(BadInput, match="broken image"):
        source.read(1.0)
    source.close()


def test_it_reads_only_a_few_captures_ahead_and_closes_at_any_time():
    inner = Counting(10**9)
    source = ReadAhead(inner, waits=True)
    source.read(1.0)
    source.close()
    source.close()
    assert inner.reads <= DEPTH + 3


def test_in_real_time_a_stalling_source_times_out():
    gate = threading.Event()

    class Stalling(Counting):
        def read(self, timeout_s):
            gate.wait(10)
            return super().read(timeout_s)

    source = ReadAhead(Stalling(3), waits=False)
    assert source.read(0.01) is None
    gate.set()
    while source.read(0.05) is None:
        pass
    source.close()


@pytest.mark.parametrize("waits", [True, False])
def test_ctrl_c_at_any_moment_does_not_block_closing(waits):
    for pressing_ctrl_c in every_moment():
        inner = Counting(10**9)
        source = ReadAhead(inner, waits=waits)
        pressing_ctrl_c(partial(source.read, 1.0))
        source.close()
        assert inner.closed == 1


class Listed(Source):
    """A source of listed captures: two images, a timeout, and a capture without image."""

    rate_hz, is_live = 30.0, False

    def __init__(self):
        self.remaining = [Capture(0, 0, IMAGE), None, Capture(1, 1, None), Capture(2, 2, IMAGE)]
        self.closed = 0

    def read(self, timeout_s):
        if not self.remaining:
            raise EndOfSource
        return self.remaining.pop(0)

    def close(self):
        self.closed += 1


@pytest.mark.parametrize("expected", [[0, 2], [0]])
def test_images_are_read_in_order_and_the_source_is_closed_also_before_its_end(expected):
    source = Listed()
    with closing(read_images(source)) as captures:
        indices = [capture.index for capture, _ in zip(captures, expected, strict=False)]
    assert indices == expected
    assert source.closed == 1
