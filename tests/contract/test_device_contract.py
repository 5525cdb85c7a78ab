"""Every device fulfils the Device contract. To add a new device, add an opener here."""

from contextlib import ExitStack

import pytest
from firmata_board import Board
from haptic_driver import DriverBoard

from haptigraph import assemble
from haptigraph.errors import BadInput
from haptigraph.haptics.observed_device import PAGE_CONTROLLER, ObservedDevice
from haptigraph.messages import Capabilities
from haptigraph.stages import Device

pytestmark = pytest.mark.realtime  # simulated boards answer in time only if they get it

# The name with which `open_device` opens each device without hardware, given an empty folder.
OPENERS = {
    "audio": lambda folder: f"audio:{folder / 'touch.wav'}",
    "console": lambda folder: "console",
    "crtk": lambda folder: "crtk:contract/MTML",
    "drv2605": lambda folder: f"drv2605:{folder / 'tty'}?motor=lra&mux=0x70&channel=0,1",
    "gamepad": lambda folder: "gamepad",
    "ros2": lambda folder: "ros2:contract/set_feedback",
    "serial": lambda folder: f"serial:{folder / 'tty'}",
    "trace": lambda folder: f"trace:{folder / 'touch.csv'}",
}


def check_capabilities(capabilities: Capabilities):
    assert capabilities.amplitude_levels >= 1
    if capabilities.frequency_range_hz is not None:
        low, high = capabilities.frequency_range_hz
        assert 0 <= low <= high
    assert capabilities.shortest_on_ms >= 0
    assert capabilities.max_rate_hz is None or capabilities.max_rate_hz > 0
    assert capabilities.holds_ms is None or capabilities.holds_ms > 0
    assert capabilities.limitations.endswith(".")


@pytest.fixture(params=assemble.DEVICES)
def device(request, tmp_path, monkeypatch):
    with ExitStack() as stack:
        if request.param in ("crtk", "ros2"):  # they report a missing subscriber
            peer = request.getfixturevalue("peer")
            from haptigraph.ros2.motion_types import WrenchStamped
            from haptigraph.ros2.types import JoyFeedback

            peer.subscribe("/contract/set_feedback", JoyFeedback)
            peer.subscribe("/contract/MTML/servo_cf", WrenchStamped)
        if request.param in ("drv2605", "serial"):
            pytest.importorskip("serial")
            board = DriverBoard if request.param == "drv2605" else Board
            stack.enter_context(board(tmp_path / "tty"))
        if request.param == "gamepad":
            pytest.importorskip("sdl2", exc_type=ImportError)
            monkeypatch.setitem(assemble.DEVICES, "gamepad", "virtual_pad:VirtualGamepad")
        device = assemble.open_device(OPENERS[request.param](tmp_path))
        stack.callback(device.close)
        yield device


def test_all_devices_are_under_contract():
    assert set(OPENERS) == set(assemble.DEVICES)


def test_a_device_reports_its_capabilities_and_an_observer_does_not_change_them(device):
    assert isinstance(device, Device)
    check_capabilities(device.capabilities)
    assert ObservedDevice(device, lambda *edge: None).capabilities == device.capabilities


def test_a_device_accepts_every_amplitude_and_silence_at_any_time(device):
    capabilities = device.capabilities
    low, high = capabilities.frequency_range_hz or (0.0, 250.0)
    commands = [(0.0, 0.0), (0.0, 0.0), (1.0, high), (1.0, high), (1e-6, low), (0.5, 80.0), (0.0, 0.0)]
    for number, (amplitude, frequency_hz) in enumerate(commands):
        device.set(amplitude, frequency_hz, number * 1_000_000)


def test_a_device_can_be_closed_twice_even_while_it_vibrates(device):
    device.set(0.0, 0.0, 0)
    device.set(0.5, 80.0, 1)
    device.close()
    device.close()


def test_the_controller_of_the_page_reports_its_capabilities():
    check_capabilities(PAGE_CONTROLLER)


@pytest.mark.parametrize(
    ("device", "library"), [("gamepad:0", "sdl2"), ("serial:0", "serial"), ("drv2605:0?motor=lra", "serial")]
)
def test_the_error_without_an_extra_names_it(device, library, tmp_path, monkeypatch):
    """Even through the watchdog process."""
    (tmp_path / f"{library}.py").write_text(f"raise ModuleNotFoundError({library!r})")
    monkeypatch.syspath_prepend(tmp_path)
    kind = device.partition(":")[0]
    extra = "serial" if library == "serial" else kind
    with pytest.raises(BadInput, match=rf"device {kind} needs an extra; .* 'haptigraph\[{extra}\]'"):
        assemble.open_device(device)
