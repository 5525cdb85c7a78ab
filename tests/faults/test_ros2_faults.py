"""What is felt at the other end of a ROS 2 network is silent in time too, and nonsense there stops nothing."""

import signal

import pytest

pytest.importorskip("cyclonedds")
pytest.importorskip("serial")

from rig import Rig
from ros_network import broken_program

from haptigraph.recording.reader import RunReader

pytestmark = [pytest.mark.xdist_group("faults"), pytest.mark.timeout(180)]


@pytest.fixture
def rig(ros_network, tmp_path):
    with Rig(tmp_path, "ros2", "--bridge", "ros2") as rig:
        steady(rig)
        yield rig


def steady(rig):
    """Wait until it has vibrated for some messages on end."""
    ear, begun = rig.ear, len(rig.ear.edges)
    with ear.changed:
        assert ear.changed.wait_for(
            lambda: len(ear.edges) > begun + 5 and all(level for _, level in ear.edges[-5:]), 30
        )


def test_a_subscriber_hears_silence_in_time_whatever_passes(rig):
    for fault in ("stale image", "lost camera", "perceiver fails twice", "interpreter stalls"):
        rig.stilled_in_time(fault, rig.begin(fault))
        rig.begin("none")
        steady(rig)
    rig.stilled_in_time("process stopped", rig.signal(signal.SIGSTOP))
    rig.signal(signal.SIGCONT)
    steady(rig)
    rig.stilled_in_time("SIGINT", rig.signal(signal.SIGINT))
    code, out, _ = rig.finish()
    assert (code, "interrupted" in out) == (0, True)


def test_a_subscriber_hears_silence_when_the_run_is_killed(rig):
    rig.stilled_in_time("SIGKILL", rig.signal(signal.SIGKILL))
    rig.finish()
    assert RunReader(rig.record).count()[0] > 0


def test_nonsense_on_the_network_neither_stills_nor_stirs_the_hand(rig):
    with broken_program():
        begun = len(rig.ear.edges)
        with rig.ear.changed:
            assert rig.ear.changed.wait_for(lambda: len(rig.ear.edges) > begun + 3, 30)
        rig.stilled_in_time("nonsense on the network, then stale image", rig.begin("stale image"))
        rig.begin("none")
        steady(rig)
    rig.stilled_in_time("SIGTERM", rig.signal(signal.SIGTERM))
    _, _, err = rig.finish()
    assert "Traceback" not in err
