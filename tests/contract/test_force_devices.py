"""Every force device fulfils the ForceDevice contract. To add a new device, add an opener here."""

import math
from contextlib import ExitStack

import pytest
from force_dimension import installed
from inverse_service import Service, serving

from haptigraph.clock import MonotonicClock
from haptigraph.haptics.force.interface import ForceDevice
from haptigraph.run_force import FORCE_DEVICES, device_class

ZERO = (0.0, 0.0, 0.0)


def crtk(stack, request):
    pytest.importorskip("cyclonedds")
    request.getfixturevalue("ros_network")
    from crtk_arm import Arm

    arm = Arm()
    stack.callback(arm.close)
    return "MTML"


def forcedimension(stack, request):
    stack.enter_context(installed())
    return "0"


def inverse3(stack, request):
    return stack.enter_context(serving(Service())).address


# What makes hardware appear, and the argument that opens it.
OPENERS = {
    "crtk": crtk,
    "forcedimension": forcedimension,
    "inverse3": inverse3,
    "simulated": lambda stack, request: "",
}

pytestmark = pytest.mark.realtime


@pytest.fixture(params=FORCE_DEVICES)
def device(request):
    with ExitStack() as stack:
        argument = OPENERS[request.param](stack, request)
        device = device_class(request.param)(argument, MonotonicClock())
        stack.callback(device.close)
        yield device


def test_all_devices_are_under_contract():
    assert set(OPENERS) == set(FORCE_DEVICES)


@pytest.mark.parametrize("kind", FORCE_DEVICES)
def test_its_capabilities_are_known_without_opening_it_and_plausible(kind):
    capabilities = device_class(kind).capabilities
    assert 0 < capabilities.max_force_n <= 5
    assert 50 <= capabilities.rate_hz <= 1000
    assert 0 < capabilities.max_speed_mm_s <= 500
    assert capabilities.damping_n_s_per_mm >= 0 and capabilities.delay_ms >= 0
    assert capabilities.axes in (2, 3)
    assert capabilities.limitations.endswith(".")


def test_it_returns_where_the_hand_is_stamped_on_our_clock(device):
    assert isinstance(device, ForceDevice)
    began_ns = MonotonicClock().now_ns()
    stamps = []
    for _ in range(20):
        reading = device.exchange(ZERO)
        assert all(map(math.isfinite, (*reading.position_mm, *reading.velocity_mm_s)))
        stamps.append(reading.stamp_ns)
    assert stamps == sorted(stamps)
    assert began_ns - 2e9 < stamps[0] <= stamps[-1] <= MonotonicClock().now_ns()


def test_it_takes_any_force_within_its_limit_and_can_be_closed_twice_even_while_it_pushes(device):
    limit_n = device.capabilities.max_force_n
    for force_n in (ZERO, (limit_n, 0.0, 0.0), (0.0, -limit_n, 0.0), (0.1, 0.2, 0.3)):
        device.exchange(force_n)
    device.close()
    device.close()
