"""The output over a ROS 2 network is silent in time as well, and invalid messages there have no effect."""

import signal

import pytest

pytest.importorskip("cyclonedds")
pytest.importorskip("serial")

from helpers import mostly_slow
from real_run import Rig
from ros_network import broken_program

from haptigraph.recording.reader import RunReader

pytestmark = [pytest.mark.xdist_group("faults"), pytest.mark.timeout(180)]


@pytest.fixture(params=mostly_slow(["ros2", "crtk"], "ros2"))
def rig(request, ros_network, tmp_path):
    with Rig(tmp_path, request.param, "--bridge", "ros2") as rig:
        await_steady(rig)
        yield rig


def await_steady(rig):
    """Wait until several consecutive messages are vibration."""
    monitor, count = rig.monitor, len(rig.monitor.edges)
    with monitor.changed:
        assert monitor.changed.wait_for(
            lambda: len(monitor.edges) > count + 5 and all(level for _, level in monitor.edges[-5:]), 30
        )


def test_a_subscriber_receives_silence_in_time_after_any_transient_fault(rig):
    for fault in ("stale image", "lost camera", "perceiver fails twice", "interpreter stalls"):
        rig.silent_in_time(fault, rig.begin(fault))
        rig.begin("none")
        await_steady(rig)
    rig.silent_in_time("process stopped", rig.signal(signal.SIGSTOP))
    rig.signal(signal.SIGCONT)
    await_steady(rig)
    rig.silent_in_time("SIGINT", rig.signal(signal.SIGINT))
    code, out, _ = rig.finish()
    assert (code, "interrupted" in out) == (0, True)


def test_a_subscriber_receives_silence_when_the_run_is_killed(rig):
    rig.until_recorded()
    rig.silent_in_time("SIGKILL", rig.signal(signal.SIGKILL))
    rig.finish()
    assert RunReader(rig.record).count()[0] > 0


def test_invalid_network_messages_neither_stop_nor_cause_vibration(rig):
    with broken_program():
        count = len(rig.monitor.edges)
        with rig.monitor.changed:
            assert rig.monitor.changed.wait_for(lambda: len(rig.monitor.edges) > count + 3, 30)
        rig.silent_in_time("invalid network messages, then stale image", rig.begin("stale image"))
        rig.begin("none")
        await_steady(rig)
    rig.silent_in_time("SIGTERM", rig.signal(signal.SIGTERM))
    _, _, err = rig.finish()
    assert "Traceback" not in err
