import math

import pytest

from haptigraph.clock import VirtualClock
from haptigraph.haptics.force.interface import ForceDevice
from haptigraph.haptics.force.simulated import ARM, ArmImpedance, SimulatedForce, SimulatedHand


def test_an_arm_yields_by_force_over_stiffness():
    hand = SimulatedHand()
    for _ in range(3000):
        hand.advance((0.0, 1.0, -0.5), 0.001)
    expected = (0.0, 1.0 / ARM.stiffness_n_per_mm, -0.5 / ARM.stiffness_n_per_mm)
    assert hand.position_mm == pytest.approx(expected, abs=0.01)


def test_a_free_mass_accelerates_by_force_over_mass():
    hand = SimulatedHand(impedance=ArmImpedance(0.5, 0.0, 0.0))
    for _ in range(100):
        hand.advance((1.0, 0.0, 0.0), 0.001)
    assert hand.velocity_mm_s[0] == pytest.approx(200.0)  # 1 N on 0.5 kg for 0.1 s
    assert hand.position_mm[0] == pytest.approx(10.0, rel=0.01)


def test_an_arm_settles_where_its_operator_wants_it():
    hand = SimulatedHand()
    hand.intended_mm = (5.0, -3.0, 1.0)
    for _ in range(3000):
        hand.advance((0.0, 0.0, 0.0), 0.001)
    assert hand.position_mm == pytest.approx((5.0, -3.0, 1.0), abs=0.01)
    assert math.hypot(*hand.velocity_mm_s) < 0.05


def test_the_device_holds_a_force_until_the_next_exchange():
    clock = VirtualClock(5)
    device = SimulatedForce("", clock, SimulatedHand(impedance=ArmImpedance(0.5, 0.0, 0.0)))
    assert isinstance(device, ForceDevice)
    assert device.exchange((1.0, 0.0, 0.0)).position_mm == (0.0, 0.0, 0.0)
    clock.wait_until(1_000_005)
    reading = device.exchange((0.0, 0.0, 0.0))
    assert reading.velocity_mm_s[0] == pytest.approx(2.0)
    assert reading.stamp_ns == 1_000_005
    clock.wait_until(2_000_005)
    assert device.exchange((0.0, 0.0, 0.0)).velocity_mm_s == reading.velocity_mm_s
    device.is_engaged = False
    assert not device.exchange((0.0, 0.0, 0.0)).engaged
    device.close()
    device.close()
