"""A controller that SDL simulates: its driver receives the commands for the motors."""

import sys

import pytest

from haptigraph.errors import BadInput, DeviceError, MissingExtra
from haptigraph.haptics.gamepad import GamepadDevice
from haptigraph.stages import Device

pytest.importorskip("sdl2", exc_type=ImportError)


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


def test_only_the_slow_motor_turns_at_low_frequency_and_both_at_high(pad, device):
    assert isinstance(device, Device)
    device.set(0.3, 80.0, 0)
    assert pad.motors() == (19660, 0)
    device.set(1.0, 160.0, 1)
    assert pad.motors() == (65535, 65535)
    device.set(0.0, 0.0, 2)
    assert pad.motors() == (0, 0)


def test_a_renewed_rumble_continues_and_another_ends_by_itself(pad, device):
    """The clock of SDL runs in real time: renew as the guard would, then only pump."""
    device.set(1.0, 160.0, 0)
    start_ns = pad.rumbles[-1][0]
    for _ in range(4):
        pad.sdl.SDL_Delay(60)
        device.set(1.0, 160.0, 0)
        assert pad.motors() == (65535, 65535)
    renewed_ns = start_ns + 240e6
    while pad.motors() != (0, 0):
        pad.sdl.SDL_Delay(5)
        pad.sdl.SDL_JoystickUpdate()
    assert pad.rumbles[-1][0] - renewed_ns >= 140e6


def test_opening_silences_what_an_earlier_process_left_vibrating(pad, device):
    """SDL passes nothing on to its driver that equals what it last sent, so silence must be a change."""
    assert [levels for _, *levels in pad.rumbles] == [[1, 0], [0, 0]]


def test_closing_stops_the_motors(pad, device):
    device.set(1.0, 160.0, 0)
    device.close()
    device.close()
    assert pad.motors() == (0, 0)


def test_a_disconnected_controller_is_reported_and_recovers(pad, device):
    device.set(1.0, 160.0, 0)
    pad.detach()
    with pytest.raises(DeviceError, match=f"controller {pad.number} is not connected; 0 are"):
        device.set(1.0, 160.0, 1)
    from virtual_pad import VirtualPad

    again = VirtualPad()
    device.set(0.5, 160.0, 2)
    assert again.motors() == (32768, 32768)
    device.close()
    again.detach()


def test_a_failing_rumble_is_reported(pad, device):
    pad.fails = True
    with pytest.raises(DeviceError, match="the controller does not rumble"):
        device.set(1.0, 160.0, 0)
    pad.fails = False
    device.set(0.0, 0.0, 0)


def test_controllers_have_names(pad):
    assert GamepadDevice.found()[f"gamepad:{pad.number}"] == "Virtual Pad"


def test_an_invalid_controller_is_refused():
    with pytest.raises(BadInput, match="gamepad:x is not a controller; use gamepad:0 for the first one"):
        GamepadDevice("x")
    with pytest.raises(BadInput, match="gamepad:99: controller 99 is not connected; 0 are"):
        GamepadDevice("99")


def test_a_controller_without_motors_is_refused():
    from virtual_pad import VirtualPad

    pad = VirtualPad(can_rumble=False)
    with pytest.raises(BadInput, match=f"controller {pad.number} cannot rumble"):
        GamepadDevice(str(pad.number))
    pad.detach()


def test_the_error_without_the_extra_names_it(monkeypatch):
    monkeypatch.setitem(sys.modules, "sdl2", None)
    with pytest.raises(MissingExtra, match=r"pip install 'haptigraph\[gamepad\]'"):
        GamepadDevice("0")
