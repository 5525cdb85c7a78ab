"""The process of a force device: errors in one sentence, replaced when it fails, and an honest end."""

import os
import re
import signal
import threading
from contextlib import ExitStack, closing

import pytest
from ros_network import until

from haptigraph.errors import BadInput, DeviceError
from haptigraph.haptics.force.process import ForceProcess
from haptigraph.run_force import open_force


def open_broken(name, **options):
    return ForceProcess(name, f"broken_force:{name}", "here", 150.0, **options)


@pytest.fixture
def opened():
    """Open a device; it is closed even if the test fails, or its process is replaced for ever."""
    with ExitStack() as stack:
        yield lambda name, **options: stack.enter_context(closing(open_broken(name, **options)))


def until_said(process, problem, times=1):
    """Wait for a problem, and hear no other but the old readings of a busy computer."""
    heard = []
    until(
        lambda: heard.extend(process.take_problems()) or heard.count(problem) >= times, f"not said: {problem}"
    )
    others = [each for each in heard if each != problem]
    assert all(re.fullmatch(r"\w+: the device's reading is \d+ ms old", each) for each in others), others


def processes():
    """The ids of this program's children."""
    own = str(os.getpid())
    found = []
    for number in filter(str.isdecimal, os.listdir("/proc")):
        try:
            with open(f"/proc/{number}/stat") as file:
                state, parent = file.read().rpartition(")")[2].split()[:2]
        except OSError:
            continue
        with open(f"/proc/{number}/cmdline") as file:
            if parent == own and state != "Z" and "haptigraph.haptics.force.loop" in file.read():
                found.append(int(number))
    return found


def test_it_reports_what_the_device_does_and_ends_when_it_has_let_go(opened):
    heard = []
    process = open_force("simulated", 150.0)
    process.close()
    assert process.has_let_go
    process = opened("Steady", listener=heard.append)
    until(lambda: len(heard) > 20, "no samples")
    assert process.capabilities.max_force_n == 3.0
    assert len(process.take()) > 15
    assert process.status().rate_hz > 0 and "cycles missed" in process.summary()
    assert not process.has_let_go
    process.close()
    process.close()
    assert process.has_let_go
    assert not set(processes()) & {process._active._process.pid, process._reserve._process.pid}


@pytest.mark.parametrize(
    "name, sentence", [("Absent", "here: nothing is plugged in"), ("Crashing", "Crashing does not open")]
)
def test_a_device_that_does_not_open_is_refused_and_leaves_no_process(name, sentence, capfd):
    before = processes()
    with pytest.raises(BadInput, match=sentence):
        open_broken(name)
    assert processes() == before


def test_a_release_that_is_not_confirmed_is_an_error():
    process = open_broken("Doubtful")
    with pytest.raises(DeviceError, match="Doubtful does not confirm that it let go; it may still push"):
        process.close()
    assert not process.has_let_go


@pytest.mark.parametrize("how, says", [("SIGKILL", "has ended"), ("SIGSTOP", "does not respond")])
def test_a_process_that_dies_or_hangs_is_replaced_and_this_is_said(opened, how, says):
    process = opened("Steady")
    first = process._active._process
    os.kill(first.pid, getattr(signal, how))
    until_said(process, f"Steady: its process {says}")
    process.take()
    until(process.take, "it is not replaced")
    assert first.poll() is not None
    process.close()
    assert process.has_let_go


def test_a_device_that_fails_is_opened_again(opened):
    process = opened("Breaking")
    until_said(process, "Breaking: the cable is loose", times=2)
    process.close()
    assert process.has_let_go


def test_an_unknown_device_is_refused_with_the_nearest_name():
    with pytest.raises(BadInput, match="did you mean 'simulated'"):
        open_force("simulate", 150.0)


def test_threads_do_not_outlive_it():
    before = threading.active_count()
    open_broken("Steady").close()
    until(lambda: threading.active_count() <= before, "threads are left behind")
