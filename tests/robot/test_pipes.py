"""Messages through pipes arrive whole, and never block the loop that sends or awaits them."""

import math
import os
import time

import msgspec
import pytest
from msgspec import Struct

from haptigraph.pipes import Frames, PipeReader, PipeWriter, framed


class Message(Struct, array_like=True):
    number: int
    value: float = 0.0


class Other(Struct, array_like=True):
    text: str


def test_messages_survive_their_way_in_pieces_and_nan_does_too():
    messages = [Message(1, 0.5), Message(2), Message(3, math.nan)]
    data, frames, received = b"".join(map(framed, messages)), Frames(), []
    for at in range(len(data)):
        received += frames.add(data[at : at + 1], Message)
    assert [each.number for each in received] == [1, 2, 3]
    assert received[0].value == 0.5 and math.isnan(received[2].value)
    with pytest.raises(msgspec.MsgspecError):
        Frames().add(framed(Message(1)), Other)


def test_a_pipe_that_nobody_reads_blocks_nothing():
    reading, writing = os.pipe()
    reports = PipeWriter(writing)
    began_s = time.monotonic()
    for _ in range(100_000):
        reports.send(Other("x" * 100))
    assert time.monotonic() - began_s < 20
    assert Frames().add(os.read(reading, 1 << 20), Other)[0] == Other("x" * 100)
    os.close(reading)
    reports.send(Other(""))  # and one that nobody can read any more does no harm
    os.close(writing)


def test_the_end_of_a_pipe_is_the_end_also_behind_messages():
    reading, writing = os.pipe()
    inputs = PipeReader(reading, Message)
    assert inputs.take() == []
    os.write(writing, framed(Message(1)))
    assert inputs.take() == [Message(1)]
    os.write(writing, framed(Message(2)))
    os.close(writing)
    assert inputs.take() is None
    os.close(reading)
