"""Over a pseudo-terminal to a board whose decoder shares nothing with the device."""

import sys

import pytest
from firmata_board import Board
from hypothesis import given
from hypothesis import strategies as st

from haptigraph.errors import BadInput, DeviceError, MissingExtra
from haptigraph.haptics import firmata
from haptigraph.haptics.firmata import FirmataDevice

pytest.importorskip("serial")


@pytest.fixture
def board(tmp_path):
    with Board(tmp_path / "tty") as board:
        yield board


def values(board, pin=9):
    return [value for _, at, value in board.edges if at == pin]


def test_the_pin_follows_the_amplitude(board):
    device = FirmataDevice(f"{board.link}?pin=9")
    assert device.capabilities.amplitude_levels == 255
    for amplitude in (0.0, 1.0, 0.3, 0.0):
        device.set(amplitude, 80.0, 0)
    assert values(board) == [0, 255, 76, 0]
    assert board.decoder.garbage == 0
    device.close()
    device.close()


def test_high_pins_and_fine_pwm_take_longer_messages(tmp_path):
    with Board(tmp_path / "tty", {20: 16, 3: 14}) as board:
        for pin, top in ((20, 65535), (3, 16383)):
            device = FirmataDevice(f"{board.link}?pin={pin}")
            assert device.capabilities.amplitude_levels == top
            device.set(1.0, 0.0, 0)
            device.set(0.5, 0.0, 0)
            assert values(board, pin) == [0, top, round(top / 2)]
            device.close()


@given(st.integers(0, 127), st.integers(0, (1 << 28) - 1))
def test_every_pin_and_value_survives_the_way(pin, value):
    from firmata_board import Decoder

    decoder = Decoder()
    (message,) = filter(None, map(decoder.feed, firmata._analog(pin, value)))
    command, data = message
    if command == 0xF0:
        assert data[:2] == bytes((0x6F, pin))
        assert sum(bits << 7 * place for place, bits in enumerate(data[2:])) == value
    else:
        assert (command, data[0] | data[1] << 7) == (0xE0 | pin, value)


def test_what_vibrated_before_is_stilled_when_the_port_is_opened(board):
    first = FirmataDevice(f"{board.link}")
    first.set(1.0, 0.0, 0)
    first._serial.close()  # dies without a word
    assert board.vibrates()
    second = FirmataDevice(f"{board.link}")
    assert not board.vibrates()
    second.close()


def test_a_board_is_stilled_before_it_is_asked_anything(board, monkeypatch):
    first = FirmataDevice(f"{board.link}")
    first.set(1.0, 0.0, 0)
    first._serial.close()
    monkeypatch.setattr(
        FirmataDevice, "_await_board", lambda device: board.until(lambda board: not board.vibrates())
    )
    FirmataDevice(f"{board.link}").close()


def test_closing_stills_the_pin(board):
    device = FirmataDevice(f"{board.link}")
    device.set(1.0, 0.0, 0)
    device.close()
    assert not board.vibrates()


def test_a_board_that_stops_answering_is_told_and_found_again(board):
    device = FirmataDevice(f"{board.link}")
    board.answers = False
    with pytest.raises(DeviceError, match="does not answer"):
        device.set(1.0, 0.0, 0)
    board.answers = True
    device.set(0.5, 0.0, 0)
    assert values(board)[-2:] == [0, 128]  # stilled first, then as told
    device.close()


def test_before_anything_vibrates_a_board_may_take_its_time(board, monkeypatch):
    monkeypatch.setattr(firmata, "ANSWER_S", 0.0)
    device = FirmataDevice(f"{board.link}")
    with pytest.raises(DeviceError, match="does not answer"):
        device.set(1.0, 0.0, 0)
    device.close()


def test_a_port_that_is_lost_while_it_is_opened_is_told(board, monkeypatch):
    def unplugged(device):
        raise OSError(5, "Input/output error")

    monkeypatch.setattr(FirmataDevice, "_learn", unplugged)
    with pytest.raises(BadInput, match=r"serial:.*tty is lost \(Input/output error\)"):
        FirmataDevice(f"{board.link}")


def test_a_board_that_was_reset_is_noticed_and_set_up_again(board):
    device = FirmataDevice(f"{board.link}")
    device.set(1.0, 0.0, 0)
    board.reset()
    with pytest.raises(DeviceError, match="was reset"):
        device.set(1.0, 0.0, 0)
    device.set(1.0, 0.0, 0)
    assert board.vibrates()
    device.close()


def test_a_board_that_is_unplugged_is_told_and_found_again(board):
    device = FirmataDevice(f"{board.link}")
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


def test_a_port_without_a_board_is_told(board, monkeypatch):
    monkeypatch.setattr(firmata, "BOOT_S", 0.2)
    board.answers = False
    with pytest.raises(BadInput, match="answers as Firmata at 57600 baud; upload the sketch StandardFirmata"):
        FirmataDevice(f"{board.link}")


@pytest.mark.parametrize(
    ("argument", "told"),
    [
        ("", "names no port"),
        ("{port}?pin=4", "pin 4 has no PWM; pins that have: 3, 5, 6, 9, 10, 11, 20"),
        ("{port}?pin=128", "pin 128 does not exist"),
        ("{port}?pin=x", "found pin=x; valid behind the port"),
        ("{port}?pins=3", "found pins=3; valid behind the port"),
        ("/dev/nothing-here", "/dev/nothing-here cannot be opened"),
    ],
)
def test_what_cannot_be_used_is_told(board, argument, told):
    with pytest.raises(BadInput, match=told.replace("?", r"\?")):
        FirmataDevice(argument.format(port=board.link))


def test_without_the_extra_one_sentence_names_it(monkeypatch):
    monkeypatch.setitem(sys.modules, "serial", None)
    with pytest.raises(MissingExtra, match=r"pip install 'haptigraph\[serial\]'"):
        FirmataDevice("/dev/ttyACM0")
