"""The Inverse3 speaks with its service as Haply documents it, and never claims a release that is unconfirmed."""

import json
import math
from contextlib import suppress
from pathlib import Path

import pytest
from inverse_service import ID, Recorded, Service, approach, serving

from haptigraph.clock import MonotonicClock, VirtualClock
from haptigraph.errors import BadInput, DeviceError
from haptigraph.haptics.force.devices.inverse3 import DEFAULT, Inverse3

CONVERSATION = Path(__file__).parents[3] / "data" / "inverse3" / "conversation.jsonl"
ZERO = (0.0, 0.0, 0.0)

pytestmark = pytest.mark.realtime


@pytest.fixture
def service():
    with serving(Service()) as service:
        yield service


@pytest.fixture
def device(service):
    device = Inverse3(service.address, MonotonicClock())
    yield device
    service.stuck_force = None
    service.is_silent = False
    with suppress(DeviceError):
        device.close()


def settled(device, exchanges=50):
    """The reading after a slow machine has caught up."""
    for _ in range(exchanges):
        reading = device.exchange(ZERO)
    return reading


def test_the_recorded_conversation_is_repeated_word_for_word():
    lines = [json.loads(line) for line in CONVERSATION.read_text().splitlines()]
    said = [(line["who"], line["text"]) for line in lines]
    with serving(Recorded(said)) as service:
        readings = approach(Inverse3(service.address, VirtualClock()), None)  # no answer is ever late
    assert service.differences == []
    assert len(said) == 17 and len(readings) == 6
    assert not readings[0].engaged and all(reading.engaged for reading in readings[1:])
    assert readings[-1].position_mm == pytest.approx((4.0, 142.0, 118.0))
    assert readings[-1].velocity_mm_s == pytest.approx((10.0, -20.0, -5.0))
    commands = [json.loads(text) for who, text in said if who == "client"]
    assert commands[0]["session"]["configure"]["basis"] == {"permutation": "XYZ"}
    assert all("session" not in command for command in commands[1:])
    forces = [command["inverse3"][0]["commands"]["set_cursor_force"]["values"] for command in commands]
    assert forces[-2:] == [{"x": 0.0, "y": 0.5, "z": 1.0}, {"x": 0.0, "y": 0.0, "z": 0.0}]


def test_the_first_force_is_zero_and_position_and_force_have_the_same_axes(device, service):
    service.position_m = (0.001, 0.002, 0.003)
    assert settled(device).position_mm == pytest.approx((1.0, 3.0, -2.0))
    assert {force for _, force in service.forces} == {ZERO}
    device.exchange((1.0, 3.0, -2.0))
    device.exchange(ZERO)
    assert (1.0, 2.0, 3.0) in [force for _, force in service.forces]


@pytest.mark.parametrize("is_wired", [False, True])
def test_a_button_of_the_grip_is_the_clutch(device, service, is_wired):
    service.is_wired = is_wired
    assert not settled(device).engaged
    service.buttons["a"] = True
    assert settled(device).engaged
    service.is_ready = False
    assert not settled(device).engaged
    service.is_ready, service.has_grip = True, False
    assert not settled(device).engaged


def test_another_button_and_one_of_several_devices_can_be_chosen(service):
    service.devices = ["1111", "2222"]
    with pytest.raises(BadInput, match=r"\?device=1111 or \?device=2222"):
        Inverse3(service.address, MonotonicClock())
    device = Inverse3(f"{service.address}?device=2222&button=c", MonotonicClock())
    service.buttons["c"] = True
    assert settled(device).engaged
    device.close()
    assert '"device_id":"2222"' in service.said[-2][1]


def test_a_late_answer_is_stamped_with_the_time_of_its_command(device, service):
    settled(device)
    service.delay_s = 0.02
    before_ns = MonotonicClock().now_ns()
    stamps = [device.exchange(ZERO).stamp_ns for _ in range(6)]
    assert stamps[0] < before_ns  # no answer yet: the reading is the one before, and says so
    assert stamps == sorted(stamps)


def test_a_service_that_falls_silent_is_an_error_and_no_release_is_claimed(device, service):
    service.is_silent = True
    with pytest.raises(DeviceError, match="does not answer in time"):
        for _ in range(100):
            device.exchange(ZERO)
    with pytest.raises(DeviceError, match="did not confirm"):
        device.close()
    device.close()


def test_a_closed_connection_is_an_error_and_no_release_is_claimed():
    with serving(Service()) as service:
        device = Inverse3(service.address, MonotonicClock())
        device.exchange(ZERO)
    with pytest.raises(DeviceError, match="is lost"):
        for _ in range(100):
            device.exchange(ZERO)
    with pytest.raises(DeviceError, match="did not confirm"):
        device.close()


@pytest.mark.parametrize("force, is_confirmed", [({"x": 0.0, "y": 0.5, "z": 0.0}, False), (None, True)])
def test_a_release_is_confirmed_only_if_the_service_reports_no_force(device, service, force, is_confirmed):
    device.exchange((0.0, 1.0, 0.0))
    service.stuck_force = force
    if is_confirmed:
        device.close()
        assert service.forces[-1][1] == ZERO
    else:
        with pytest.raises(DeviceError, match="did not confirm"):
            device.close()


def test_a_service_that_reports_no_forces_confirms_by_its_answer(device, service):
    service.reports_no_force = True
    device.exchange((0.0, 1.0, 0.0))
    device.close()
    assert service.forces[-1][1] == ZERO


def test_a_device_that_vanishes_from_the_states_is_lost(device, service):
    service.devices = []
    with pytest.raises(DeviceError, match="does not answer in time"):
        for _ in range(10_000):
            device.exchange(ZERO)


def test_a_position_that_is_no_number_is_an_error(device, service):
    service.position_m = (math.nan, 0.0, 0.0)
    with pytest.raises(DeviceError, match="invalid message"):
        settled(device)


@pytest.mark.parametrize(
    "change, sentence",
    [
        ({"devices": []}, "no Inverse3"),
        ({"has_grip": False}, "no VerseGrip, whose button is the clutch"),
        ({"is_calibrated": False}, f"{ID} is not calibrated"),
    ],
)
def test_what_is_missing_is_said_in_one_sentence(service, change, sentence):
    for name, value in change.items():
        setattr(service, name, value)
    with pytest.raises(BadInput, match=sentence):
        Inverse3(service.address, MonotonicClock())


@pytest.mark.parametrize(
    "argument, sentence",
    [
        ("127.0.0.1:1", "cannot be reached at 127.0.0.1:1"),
        ("nowhere", "expected HOST:PORT"),
        ("localhost:0", "expected HOST:PORT"),
        ("?knob=a", "unknown option 'knob'"),
        ("?button=d", "unknown button 'd'"),
    ],
)
def test_a_wrong_argument_is_refused(argument, sentence):
    with pytest.raises(BadInput, match=sentence.replace("?", r"\?")):
        Inverse3(argument, MonotonicClock())


def test_another_server_is_refused():
    import socketserver
    import threading

    class Web(socketserver.BaseRequestHandler):
        def handle(self):
            self.request.recv(4096)
            self.request.sendall(b"HTTP/1.1 404 Not Found\r\ncontent-length: 0\r\n\r\n")

    with socketserver.TCPServer(("127.0.0.1", 0), Web) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        with pytest.raises(BadInput, match="cannot be reached"):
            Inverse3(f"127.0.0.1:{server.server_address[1]}", MonotonicClock())
        server.shutdown()


def test_nothing_is_found_where_no_service_runs():
    assert DEFAULT == "localhost:10001"
    assert isinstance(Inverse3.found(), dict)
