"""Work in a process of its own: what it returns, tells, refuses, and how it ends otherwise."""

import os

import pytest

from haptigraph.dashboard.aside import aside
from haptigraph.errors import BadInput, HaptigraphError


def works(number, tell):
    tell("half")
    return number + 1, os.getpid(), os.nice(0)


def refuses(tell):
    raise BadInput("no good", "eye.png", "line 3")


def dies(tell):
    os._exit(7)


def test_it_returns_and_tells_from_another_process_that_gives_way():
    told = []
    number, process, nice = aside(works, 1, progress=told.append)
    assert (number, told) == (2, ["half"])
    assert process != os.getpid() and nice > os.nice(0)


def test_a_refusal_comes_back_as_it_was():
    with pytest.raises(BadInput) as refused:
        aside(refuses, progress=print)
    assert str(refused.value) == "eye.png, line 3: no good"


def test_a_death_is_told():
    with pytest.raises(HaptigraphError, match="ended too early, with exit code 7"):
        aside(dies, progress=print)
