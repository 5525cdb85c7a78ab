"""A CRTK arm as a force device: poses in, forces out, the clutch of the leader, and no arm that is lost unnoticed."""

from contextlib import suppress

import pytest
from ros_network import until

from haptigraph.clock import MonotonicClock
from haptigraph.errors import BadInput, DeviceError
from haptigraph.haptics.force.devices import crtk
from haptigraph.haptics.force.devices.crtk import CrtkForce

pytest.importorskip("cyclonedds")
ZERO = (0.0, 0.0, 0.0)


@pytest.fixture
def arm(ros_network):
    from crtk_arm import Arm

    arm = Arm()
    yield arm
    arm.close()


@pytest.fixture
def device(arm):
    device = CrtkForce("MTML", MonotonicClock())
    yield device
    with suppress(DeviceError):
        device.close()


def has(device, matches):
    return lambda: matches(device.exchange(ZERO))


def test_the_first_force_is_zero_and_poses_arrive(device, arm):
    until(lambda: arm.forces, "no force")
    assert set(arm.forces) == {ZERO}
    arm.at_m, arm.velocity_m_s = (0.001, 0.002, 0.003), (0.01, 0.02, 0.03)
    until(has(device, lambda reading: reading.position_mm == pytest.approx((1, 2, 3))), "no pose")
    until(has(device, lambda reading: reading.velocity_mm_s == pytest.approx((10, 20, 30))), "no velocity")


def test_the_base_of_the_arm_may_be_turned(arm):
    device = CrtkForce("MTML?rotate=0,0,90", MonotonicClock())
    arm.at_m = (0.001, 0.0, 0.0)
    until(
        has(device, lambda reading: reading.position_mm == pytest.approx((0, 1, 0), abs=1e-9)), "not turned"
    )
    device.exchange((0.0, 0.5, 0.0))  # what pushes up pushes along the arm's x
    until(lambda: any(force == pytest.approx((0.5, 0, 0), abs=1e-9) for force in arm.forces), "no force")
    device.close()


def test_the_clutch_is_that_of_the_leader(device, arm):
    assert not device.exchange(ZERO).engaged
    arm.is_present = True
    until(has(device, lambda reading: reading.engaged), "not engaged")
    arm.is_clutched = True
    until(has(device, lambda reading: not reading.engaged), "still engaged")


def test_a_silent_arm_is_lost(device, arm):
    arm.is_silent = True
    with pytest.raises(DeviceError, match=r"the arm of /MTML/servo_cf is silent"):
        until(has(device, lambda reading: False), "still there")


def test_the_end_is_a_force_of_zero(device, arm):
    device.exchange((1.0, 0.0, 0.0))
    until(lambda: (1.0, 0.0, 0.0) in arm.forces, "no force")
    device.close()
    until(lambda: arm.forces[-1] == ZERO, "it pushes on")
    device.close()


def test_an_arm_that_has_left_does_not_count_as_let_go(arm):
    device = CrtkForce("MTML", MonotonicClock())
    arm.close()
    until(lambda: not device._publisher.has_subscribers, "still subscribed")
    with pytest.raises(DeviceError, match="may keep its last force"):
        device.close()


def test_an_arm_that_is_absent_is_refused(ros_network, monkeypatch):
    monkeypatch.setattr(crtk, "DISCOVERY_S", 0.1)
    with pytest.raises(BadInput, match="no arm subscribes to /NONE/servo_cf"):
        CrtkForce("NONE", MonotonicClock())


@pytest.mark.parametrize(
    "argument, sentence",
    [
        ("", "needs the arm's namespace"),
        ("MTML?newton=1", "unknown option 'newton'"),
        ("MTML?rotate=1", "three angles"),
    ],
)
def test_an_invalid_argument_is_refused(argument, sentence, ros_network):
    with pytest.raises(BadInput, match=sentence):
        CrtkForce(argument, MonotonicClock())
