"""Over a pseudo-terminal to a simulated board whose decoder shares no code with the device."""

import sys

import pytest
from firmata_board import Board
from hypothesis import given
from hypothesis import strategies as st

from haptigraph.errors import BadInput, DeviceError, MissingExtra
from haptigraph.haptics.boards import board as boards
from haptigraph.haptics.boards import pwm
from haptigraph.haptics.boards.pwm import PwmDevice

pytest.importorskip("serial")


@pytest.fixture
def board(tmp_path):
    with Board(tmp_path / "tty") as board:
        yield board


def values(board, pin=9):
    return [value for _, at, value in board.edges if at == pin]


def test_the_pin_follows_the_amplitude(board):
    device = PwmDevice(f"{board.link}?pin=9")
    assert device.capabilities.amplitude_levels == 255
    for amplitude in (0.0, 1.0, 0.3, 0.0):
        device.set(amplitude, 80.0, 0)
    assert values(board) == [0, 255, 76, 0]
    assert board.decoder.garbage == 0
    device.close()
    device.close()


def test_high_pins_and_high_resolutions_use_longer_messages(tmp_path):
    with Board(tmp_path / "tty", {20: 16, 3: 14}) as board:
        for pin, maximum in ((20, 65535), (3, 16383)):
            device = PwmDevice(f"{board.link}?pin={pin}")
            assert device.capabilities.amplitude_levels == maximum
            device.set(1.0, 0.0, 0)
            device.set(0.5, 0.0, 0)
            assert values(board, pin) == [0, maximum, round(maximum / 2)]
            device.close()


@given(st.integers(0, 127), st.integers(0, (1 << 28) - 1))
def test_every_pin_and_value_is_decoded_unchanged(pin, value):
    from firmata_board import Decoder

    decoder = Decoder()
    (message,) = filter(None, map(decoder.feed, pwm._analog(pin, value)))
    command, data = message
    if command == 0xF0:
        assert data[:2] == bytes((0x6F, pin))
        assert sum(bits << 7 * place for place, bits in enumerate(data[2:])) == value
    else:
        assert (command, data[0] | data[1] << 7) == (0xE0 | pin, value)


def test_opening_the_port_silences_an_earlier_vibration(board):
    first = PwmDevice(f"{board.link}")
    first.set(1.0, 0.0, 0)
    first._board._serial.close()  # dies without a message
    assert board.vibrates()
    second = PwmDevice(f"{board.link}")
    assert not board.vibrates()
    second.close()


def test_a_board_is_silenced_before_any_query(board, monkeypatch):
    first = PwmDevice(f"{board.link}")
    first.set(1.0, 0.0, 0)
    first._board._serial.close()
    monkeypatch.setattr(
        boards.FirmataBoard, "_await_answer", lambda device: board.until(lambda board: not board.vibrates())
    )
    PwmDevice(f"{board.link}").close()


def test_closing_silences_the_pin(board):
    device = PwmDevice(f"{board.link}")
    device.set(1.0, 0.0, 0)
    device.close()
    assert not board.vibrates()


def test_a_board_that_stops_responding_is_reported_and_recovers(board):
    device = PwmDevice(f"{board.link}")
    board.responds = False
    with pytest.raises(DeviceError, match="does not respond"):
        device.set(1.0, 0.0, 0)
    board.responds = True
    device.set(0.5, 0.0, 0)
    assert values(board)[-2:] == [0, 128]  # silenced first, then as set
    device.close()


def test_during_setup_a_board_may_be_slow(board, monkeypatch):
    monkeypatch.setattr(boards, "RESPONSE_S", 0.0)
    device = PwmDevice(f"{board.link}")
    with pytest.raises(DeviceError, match="does not respond"):
        device.set(1.0, 0.0, 0)
    monkeypatch.undo()
    device.close()


def test_a_response_without_content_is_an_error_of_the_device(board):
    device = PwmDevice(f"{board.link}")
    board.corrupts = True
    with pytest.raises(DeviceError, match="sends a response without content"):
        device.set(1.0, 0.0, 0)
    board.until(lambda board: not board.vibrates())
    with pytest.raises(DeviceError, match="pin 9 does not support PWM"):
        device.set(1.0, 0.0, 0)
    board.corrupts = False
    device.close()
    device.close()


@pytest.mark.parametrize("bits", [0, 17])
def test_an_impossible_resolution_is_refused(tmp_path, bits):
    with Board(tmp_path / "tty", {9: bits}) as board, pytest.raises(BadInput, match=f"PWM of {bits} bits"):
        PwmDevice(f"{board.link}")


def test_closing_raises_if_silence_is_not_confirmed(board):
    device = PwmDevice(f"{board.link}")
    device.set(1.0, 0.0, 0)
    board.responds = False
    with pytest.raises(DeviceError, match="does not respond"):
        device.close()
    board.until(lambda board: not board.vibrates())  # it obeyed, but nobody knows


def test_a_port_that_is_lost_while_it_is_opened_is_reported(board, monkeypatch):
    def unplugged(device):
        raise OSError(5, "Input/output error")

    monkeypatch.setattr(PwmDevice, "_query_max_value", unplugged)
    with pytest.raises(BadInput, match=r"serial:.*tty is lost \(Input/output error\)"):
        PwmDevice(f"{board.link}")


def test_a_board_that_was_reset_is_detected_and_set_up_again(board):
    device = PwmDevice(f"{board.link}")
    device.set(1.0, 0.0, 0)
    board.reset()
    with pytest.raises(DeviceError, match="was reset"):
        device.set(1.0, 0.0, 0)
    device.set(1.0, 0.0, 0)
    assert board.vibrates()
    device.close()


def test_an_unplugged_board_is_reported_and_recovers(board):
    device = PwmDevice(f"{board.link}")
    device.set(1.0, 0.0, 0)
    board.unplug()
    with pytest.raises(DeviceError, match=f"{board.link} "):
        device.set(1.0, 0.0, 0)
    with pytest.raises(DeviceError, match="cannot be opened"):
        device.set(1.0, 0.0, 0)
    board.plug()
    device.set(1.0, 0.0, 0)
    assert board.vibrates()
    device.close()


def test_a_port_without_a_board_is_reported(board, monkeypatch):
    monkeypatch.setattr(boards, "BOOT_S", 0.2)
    board.responds = False
    with pytest.raises(BadInput, match="answers as Firmata at 57600 baud; upload the sketch StandardFirmata"):
        PwmDevice(f"{board.link}")


@pytest.mark.parametrize(
    ("argument", "problem"),
    [
        ("", "no port is given; use serial:/dev/ttyACM0?pin=N&baud=N"),
        ("{port}?pin=4", "pin 4 does not support PWM; use one of 3, 5, 6, 9, 10, 11, 20"),
        ("{port}?pin=128", "found pin=128; valid: 0 to 127"),
        ("{port}?pin=x", "found pin=x; valid: 0 to 127"),
        ("{port}?pins=3", "found pins=3; valid after the port"),
        ("/dev/nothing-here", "/dev/nothing-here cannot be opened"),
    ],
)
def test_an_unusable_argument_is_refused(board, argument, problem):
    with pytest.raises(BadInput, match=problem.replace("?", r"\?")):
        PwmDevice(argument.format(port=board.link))


def test_the_error_without_the_extra_names_it(monkeypatch):
    monkeypatch.setitem(sys.modules, "serial", None)
    with pytest.raises(MissingExtra, match=r"pip install 'haptigraph\[serial\]'"):
        PwmDevice("/dev/ttyACM0")
