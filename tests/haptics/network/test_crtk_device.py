"""A leader arm that feels a force: its size, its mean, and that it ends."""

import os
import signal
import subprocess
import sys

import pytest
from hypothesis import given
from hypothesis import strategies as st
from ros_network import until

pytest.importorskip("cyclonedds")

from haptigraph.errors import BadInput, DeviceError
from haptigraph.haptics.network import crtk
from haptigraph.haptics.network.crtk import (
    DEFAULT_N,
    FREQUENCY_HZ,
    HOLDS_MS,
    LIMIT_N,
    RATE_HZ,
    CrtkDevice,
    Swing,
)
from haptigraph.ros2.motion_types import WrenchStamped

TOPIC = "/hand/servo_cf"
AMPLITUDES = st.floats(allow_nan=True, allow_infinity=True)


@given(
    newton=st.floats(1e-3, LIMIT_N),
    commands=st.lists(st.tuples(AMPLITUDES, AMPLITUDES, st.floats(0, 0.3)), max_size=20),
)
def test_the_force_never_exceeds_its_limit_whatever_is_commanded(newton, commands):
    swing, now_s = Swing(newton), 0.0
    for amplitude, frequency_hz, pause_s in commands:
        swing.set(amplitude, frequency_hz, now_s)
        for step in range(4):
            size_n = abs(swing.force_n(now_s + pause_s * step / 4))
            assert size_n <= newton * (1 + 1e-12)
        now_s += pause_s


@given(amplitude=st.floats(0.01, 1), frequency_hz=st.floats(*FREQUENCY_HZ))
def test_the_mean_force_is_zero_over_whole_periods(amplitude, frequency_hz):
    swing, mean_n, count = Swing(1.0), 0.0, round(20 * RATE_HZ / frequency_hz)
    for step in range(count):
        now_s = 20 / frequency_hz * step / count
        if step % 20 == 0:
            swing.set(amplitude, frequency_hz, now_s)
        mean_n += swing.force_n(now_s) / count
    assert abs(mean_n) < 0.01 * amplitude


def test_it_swings_at_the_frequency_of_the_pattern_with_its_amplitude():
    swing = Swing(1.0)
    swing.set(0.5, 50.0, 0.0)
    forces = [swing.force_n(ms / 1e3) for ms in range(40)]
    assert max(forces) == pytest.approx(0.5, abs=0.01) and min(forces) == pytest.approx(-0.5, abs=0.01)
    ups = [ms for ms in range(1, 40) if forces[ms - 1] <= 0 < forces[ms]]
    assert ups == [1, 21]


@pytest.mark.parametrize(("frequency_hz", "used_hz"), [(0.0, 80.0), (5.0, 20.0), (250.0, 100.0)])
def test_a_frequency_beyond_the_publishing_rate_is_limited(frequency_hz, used_hz):
    one, other = Swing(1.0), Swing(1.0)
    one.set(1.0, frequency_hz, 0.0)
    other.set(1.0, used_hz, 0.0)
    assert [one.force_n(ms / 1e3) for ms in range(20)] == [other.force_n(ms / 1e3) for ms in range(20)]


def test_it_ends_by_itself_and_silence_is_immediate():
    swing = Swing(1.0)
    swing.set(1.0, 80.0, 0.0)
    assert swing.force_n(0.003) != 0
    swing.set(0.0, 0.0, 0.004)
    assert swing.force_n(0.004) == 0 and not swing.is_on
    swing.set(1.0, 80.0, 0.01)
    assert swing.force_n(0.01 + HOLDS_MS / 1e3 - 0.001) != 0
    assert swing.force_n(0.01 + HOLDS_MS / 1e3) == 0 and not swing.is_on


@pytest.fixture
def arm(peer):
    peer.subscribe(TOPIC, WrenchStamped)
    return peer


def next_force(arm, matches=lambda force: True):
    return arm.next(TOPIC, lambda message: matches(message.wrench.force)).wrench.force


@pytest.fixture
def device(arm):
    device = CrtkDevice("hand")
    yield device
    device.close()


def test_the_arm_receives_a_force_in_both_directions_within_the_limit(device, arm):
    device.set(1.0, 80.0, 0)
    until_both = {False, True}
    while until_both:
        force = next_force(arm, lambda force: force.x != 0)
        assert abs(force.x) <= DEFAULT_N and force.y == force.z == 0
        until_both.discard(force.x > 0)


def test_silence_is_sent_at_once_and_repeated(device, arm):
    device.set(1.0, 80.0, 0)
    next_force(arm, lambda force: force.x != 0)
    device.set(0.0, 0.0, 1)
    next_force(arm, lambda force: force.x == 0)
    for _ in range(10):
        assert next_force(arm).x == 0


def test_without_a_command_it_falls_silent(device, arm):
    device.set(1.0, 80.0, 0)
    next_force(arm, lambda force: force.x != 0)
    until(lambda: not device._swing.is_on, "it swings on")
    device.set(0.0, 0.0, 1)


def test_the_last_force_is_zero(device, arm):
    device.set(1.0, 80.0, 0)
    next_force(arm, lambda force: force.x != 0)
    device.close()
    last = None
    while not arm.received[TOPIC].empty() or last is None:
        last = next_force(arm)
    assert last.x == 0
    with pytest.raises(DeviceError, match="cannot be published"):
        device.set(1.0, 80.0, 2)


def test_an_arm_that_does_not_subscribe_is_reported(ros_network, monkeypatch):
    monkeypatch.setattr(crtk, "DISCOVERY_S", 0.0)
    device = CrtkDevice("nobody?newton=1")
    with pytest.raises(DeviceError, match="no arm subscribes to /nobody/servo_cf"):
        device.set(1.0, 80.0, 0)
    device.close()


RUN = """
import sys
from haptigraph.assemble import open_device
device = open_device("crtk:hand")
print("open", flush=True)
while True:
    device.set(1.0, 80.0, 0)
"""


@pytest.mark.parametrize("end", [signal.SIGKILL, signal.SIGSTOP])
def test_a_run_that_dies_or_hangs_leaves_no_force(arm, end):
    with subprocess.Popen(
        [sys.executable, "-c", RUN],
        stdout=subprocess.PIPE,
        text=True,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))},
    ) as run:
        try:
            assert run.stdout.readline() == "open\n"
            next_force(arm, lambda force: force.x != 0)
            run.send_signal(end)
            for _ in range(25):  # a swing passes zero, but does not stay there
                while next_force(arm).x != 0:
                    pass
                if all(next_force(arm).x == 0 for _ in range(10)):
                    break
            else:
                raise AssertionError("the arm still feels a force")
        finally:
            run.kill()


@pytest.mark.parametrize(
    ("argument", "sentence"),
    [
        ("", "device crtk needs the arm's namespace, for example crtk:MTML/body"),
        ("MTML?newton=2.5", "newton=2.5: expected the largest force in N, above 0, at most 2"),
        ("MTML?newton=-1", "newton=-1: expected"),
        ("MTML?newton=nan", "newton=nan: expected"),
        ("MTML?newton=", "newton=: expected"),
        ("MTML?axis=y", "unknown option 'axis'; valid: newton"),
        ("my arm", "is no ROS topic"),
    ],
)
def test_an_invalid_argument_is_refused(argument, sentence, ros_network):
    with pytest.raises(BadInput) as refusal:
        CrtkDevice(argument)
    assert sentence in str(refusal.value)


def test_arms_that_accept_a_force_are_found(arm):
    assert "accepts servo_cf on ROS domain" in CrtkDevice.found()["crtk:hand"]
