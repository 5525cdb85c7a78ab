"""A controller simulated by SDL itself: what its driver is told is what a motor would do."""

import sys

import pytest

from haptigraph.errors import BadInput, DeviceError, MissingExtra
from haptigraph.haptics.gamepad import GamepadDevice
from haptigraph.stages import Device

pytest.importorskip("sdl2", exc_type=ImportError)
pytestmark = pytest.mark.xdist_group("sdl")


@pytest.fixture
def pad():
    from virtual_pad import VirtualPad

    pad = VirtualPad()
    yield pad
    pad.detach()


@pytest.fixture
def device(pad):
    device = GamepadDevice(str(pad.number))
    yield device
    device.close()


def test_the_slow_motor_turns_for_what_is_low_and_both_for_what_is_high(pad, device):
    assert isinstance(device, Device)
    device.set(0.3, 80.0, 0)
    assert pad.motors() == (19660, 0)
    device.set(1.0, 160.0, 1)
    assert pad.motors() == (65535, 65535)
    device.set(0.0, 0.0, 2)
    assert pad.motors() == (0, 0)


def test_a_rumble_that_is_told_again_goes_on_and_one_that_is_not_ends_by_itself(pad, device):
    """SDL's clock runs in real time: pump it as the guard would, then pump without telling."""
    device.set(1.0, 160.0, 0)
    began_ns = pad.rumbles[-1][0]
    for _ in range(4):
        pad.sdl.SDL_Delay(60)
        device.set(1.0, 160.0, 0)
        assert pad.motors() == (65535, 65535)
    told_ns = began_ns + 240e6
    while pad.motors() != (0, 0):
        pad.sdl.SDL_Delay(5)
        pad.sdl.SDL_JoystickUpdate()
    assert pad.rumbles[-1][0] - told_ns >= 140e6


def test_closing_stops_the_motors(pad, device):
    device.set(1.0, 160.0, 0)
    device.close()
    device.close()
    assert pad.motors() == (0, 0)


def test_a_controller_that_goes_away_is_told_and_found_again(pad, device):
    device.set(1.0, 160.0, 0)
    pad.detach()
    with pytest.raises(DeviceError, match=f"there is no controller {pad.number}"):
        device.set(1.0, 160.0, 1)
    from virtual_pad import VirtualPad

    again = VirtualPad()
    device.set(0.5, 160.0, 2)
    assert again.motors() == (32768, 32768)
    device.close()
    again.detach()


def test_a_controller_that_refuses_is_told(pad, device):
    pad.fails = True
    with pytest.raises(DeviceError, match="the controller does not rumble"):
        device.set(1.0, 160.0, 0)
    pad.fails = False
    device.set(0.0, 0.0, 0)


def test_controllers_have_names(pad):
    assert GamepadDevice.found()[f"gamepad:{pad.number}"] == "Virtual Pad"


def test_what_is_no_controller_is_told():
    with pytest.raises(BadInput, match="gamepad:x is no controller; gamepad:0 is the first"):
        GamepadDevice("x")
    with pytest.raises(BadInput, match="gamepad:99: there is no controller 99; 0 are connected"):
        GamepadDevice("99")


def test_a_controller_without_motors_is_told():
    from virtual_pad import VirtualPad

    pad = VirtualPad(can_rumble=False)
    with pytest.raises(BadInput, match=f"controller {pad.number} cannot rumble"):
        GamepadDevice(str(pad.number))
    pad.detach()


def test_without_the_extra_one_sentence_names_it(monkeypatch):
    monkeypatch.setitem(sys.modules, "sdl2", None)
    with pytest.raises(MissingExtra, match=r"pip install 'haptigraph\[gamepad\]'"):
        GamepadDevice("0")
