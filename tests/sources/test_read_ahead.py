import threading
from functools import partial

import numpy as np
import pytest
from helpers import every_moment

from haptigraph.errors import BadInput, EndOfSource
from haptigraph.messages import Capture
from haptigraph.sources.read_ahead import DEPTH, ReadAhead

IMAGE = np.zeros((2, 2), np.uint8)


class Counting:
    rate_hz, is_live, registration = 30.0, False, "text"

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


def test_order_and_end_are_kept():
    inner = Counting(50)
    source = ReadAhead(inner, waits=True)
    assert (source.rate_hz, source.registration) == (30.0, "text")
    assert [source.read(1.0).index for _ in range(50)] == list(range(50))
    for _ in range(2):
        with pytest.raises(EndOfSource):
            source.read(1.0)
    source.close()
    assert inner.closed == 1
    assert inner.threads == {"haptigraph-read-ahead"}


def test_errors_come_to_the_reader():
    source = ReadAhead(Counting(1, BadInput("broken image")), waits=True)
    source.read(1.0)
    with pytest.raises(BadInput, match="broken image"):
        source.read(1.0)
    source.close()


def test_it_reads_only_a_little_ahead_and_closes_in_the_middle():
    inner = Counting(10**9)
    source = ReadAhead(inner, waits=True)
    source.read(1.0)
    source.close()
    source.close()
    assert inner.reads <= DEPTH + 3


def test_in_real_time_a_source_that_stalls_is_told_in_time():
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
def test_ctrl_c_at_any_moment_does_not_hold_up_the_end(waits):
    for pressing_ctrl_c in every_moment():
        inner = Counting(10**9)
        source = ReadAhead(inner, waits=waits)
        pressing_ctrl_c(partial(source.read, 1.0))
        source.close()
        assert inner.closed == 1
