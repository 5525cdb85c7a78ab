"""Over a pseudo-terminal to drivers that are simulated at the level of their registers."""

import time
from contextlib import suppress

import pytest
from haptic_driver import DriverBoard
from helpers import LOW, PULSE, SUCCESS

from haptigraph.analysis.actuators import play_grammar
from haptigraph.clock import MonotonicClock
from haptigraph.errors import BadInput, DeviceError
from haptigraph.haptics.boards import board as boards
from haptigraph.haptics.boards.drv2605 import Drv2605Device

pytest.importorskip("serial")

TWO = "?motor=lra&mux=0x70&channel=0,1"
ENABLED = f"{TWO}&enable=7"


@pytest.fixture(autouse=True)
def patience(monkeypatch):
    """Other work on the machine may delay the board; where a test is about its silence, it sets its own."""
    monkeypatch.setattr("haptigraph.haptics.boards.drv2605.RESPONSE_S", 2.0)
    monkeypatch.setattr(boards, "RESPONSE_S", 2.0)


@pytest.fixture
def board(tmp_path):
    with DriverBoard(tmp_path / "tty", (0, 1), enable_pin=7) as board:
        yield board


@pytest.fixture
def bare(tmp_path):
    """A board with one driver, without a multiplexer."""
    with DriverBoard(tmp_path / "tty", ()) as board:
        yield board


def silent(board):
    return not board.vibrates()


def opened(board, options=ENABLED):
    return Drv2605Device(f"{board.link}{options}")


def test_both_actuators_play_every_amplitude(board):
    device = opened(board)
    assert device.capabilities.amplitude_levels == 255
    for value in (*range(256), 0):
        device.set(value / 255, 0.0, 0)
        assert board.now == (value / 255, value / 255)
    assert board.decoder.garbage == 0
    device.close()
    device.close()


def test_both_actuators_get_a_command_at_once(board):
    device = opened(board)
    board.outputs.clear()
    device.set(1.0, 0.0, 0)
    device.set(0.0, 0.0, 0)
    stamps_ns = [stamp_ns for stamp_ns, _ in board.outputs]
    assert [output for _, output in board.outputs] == [(1.0, 0.0), (1.0, 1.0), (0.0, 1.0), (0.0, 0.0)]
    assert (
        stamps_ns[1] - stamps_ns[0] < 20e6
    )  # in one transaction on the bus; a busy machine may come between
    device.close()


@pytest.mark.parametrize("motor", ["erm", "lra"])
def test_one_driver_needs_no_multiplexer(bare, motor):
    device = opened(bare, f"?motor={motor}")
    device.set(0.3, 0.0, 0)
    assert bare.now == (76 / 255,)
    device.close()
    bare.until(silent)


def test_it_plays_the_grammar(board):
    trial = play_grammar(opened(board), (LOW, PULSE, SUCCESS), MonotonicClock(), lambda line: None)
    assert trial.faults == []
    assert trial.is_silent
    felt = [round(255 * first) for _, (first, second) in board.outputs if first == second and first]
    low, bursts = felt.index(255), len(felt) - 2
    assert set(felt[:low]) == {76}
    assert set(felt[low:bursts]) == {255}
    assert 5 <= bursts - low <= 10
    assert felt[bursts:] == [204, 204]


def test_the_motor_gets_what_its_data_say(board):
    device = opened(board, f"{TWO}&rated_v=2&clamp_v=3&hz=205")
    for driver in board.drivers.values():
        assert driver.registers[0x16] == round(2 * (1 - 1.5e-3 * 205) ** 0.5 / 20.58e-3)
        assert driver.registers[0x17] == int(3 / 21.22e-3)
    device.close()


def test_opening_the_port_silences_an_earlier_vibration(board):
    first = opened(board)
    first.set(1.0, 0.0, 0)
    first._board._serial.close()  # dies without a message
    assert board.vibrates()
    second = opened(board)
    assert not board.vibrates()
    second.close()


def test_a_board_that_missed_the_first_messages_is_silenced_before_its_drivers_are_looked_at(
    board, monkeypatch
):
    """An Uno restarts when its port is opened, and its drivers go on meanwhile."""
    board.enable_pin = None
    board.set_enabled()
    first = opened(board, TWO)
    first.set(1.0, 0.0, 0)
    first._board._serial.close()  # dies without a message
    board.reset()
    board.drivers[0].answers = False
    with pytest.raises(BadInput, match="nothing answers"):
        opened(board, TWO)
    board.until(lambda board: board.drivers[1].output == 0)
    assert board.drivers[0].output == 1  # nothing reaches it


def test_closing_puts_the_drivers_into_standby_and_disables_them(board):
    device = opened(board)
    device.set(1.0, 0.0, 0)
    device.close()
    board.until(lambda board: not any(driver.enabled for driver in board.drivers.values()))
    assert [driver.registers[1] for driver in board.drivers.values()] == [0x45, 0x45]


def test_closing_raises_if_silence_is_not_confirmed(board, monkeypatch):
    monkeypatch.setattr(boards, "RESPONSE_S", 0.1)
    device = opened(board)
    device.set(1.0, 0.0, 0)
    board.responds = False
    with pytest.raises(DeviceError, match="does not respond"):
        device.close()
    board.until(silent)  # it obeyed, but nobody knows


# --- faults ---------------------------------------------------------------------------------------------


def fails(device, match, amplitude=1.0):
    with pytest.raises(DeviceError, match=match):
        device.set(amplitude, 0.0, 0)


def until_it_plays(device, board):
    """Repeat a command until it succeeds, as the guard does."""
    give_up_s = time.monotonic() + 20
    while time.monotonic() < give_up_s:
        with suppress(DeviceError):
            device.set(0.5, 0.0, 0)
            assert board.now == (128 / 255,) * len(board.drivers)
            return
        time.sleep(0.05)
    raise AssertionError("it does not play again")


def test_a_driver_that_was_reset_is_detected_and_set_up_again(board):
    device = opened(board)
    device.set(1.0, 0.0, 0)
    board.drivers[1].power_up()
    fails(device, "the driver on channel 1 was reset")
    board.until(silent)
    until_it_plays(device, board)
    device.close()


def test_a_reset_is_detected_even_in_silence(board):
    device = opened(board)
    board.drivers[0].power_up()
    fails(device, "the driver on channel 0 was reset", amplitude=0.0)
    device.close()


def test_a_driver_that_does_not_listen_is_detected_though_the_board_repeats_an_old_answer(bare):
    device = opened(bare, "?motor=erm")
    device.set(1.0, 0.0, 0)
    bare.drivers[None].answers = False
    fails(device, r"nothing answers at the I2C address 0x5a \(I2C: Too few bytes received\)")
    assert bare.vibrates()  # nothing can silence it
    with pytest.raises(DeviceError, match="nothing answers"):
        device.close()


def test_a_driver_that_does_not_listen_is_silenced_by_its_enable_pin(board):
    device = opened(board)
    device.set(1.0, 0.0, 0)
    board.drivers[1].answers = False
    fails(device, "nothing answers at the I2C address 0x5a")
    board.until(silent)
    fails(device, "nothing answers")  # tried once, and disabled again
    board.until(silent)
    fails(device, "are tried once a second")
    assert silent(board)
    board.drivers[1].answers = True
    until_it_plays(device, board)
    device.close()


def test_closing_tries_to_confirm_silence_at_once(board):
    device = opened(board)
    board.drivers[1].answers = False
    fails(device, "nothing answers")
    fails(device, "nothing answers")
    board.drivers[1].answers = True
    device.close()


def test_a_multiplexer_that_does_not_switch_is_detected_and_the_enable_pin_silences(board):
    device = opened(board)
    device.set(1.0, 0.0, 0)
    board.multiplexer.mask, board.multiplexer.is_stuck = 1 << 5, True
    fails(device, "the multiplexer at 0x70 does not switch to channel 0; connected: 5")
    board.until(silent)
    board.outputs.clear()
    fails(device, "does not switch")
    assert not any(
        max(output) for _, output in board.outputs
    )  # not even for a moment, because the drivers are not enabled again
    board.multiplexer.is_stuck = False
    until_it_plays(device, board)
    device.close()


def test_a_multiplexer_that_stays_on_one_channel_is_not_mistaken_for_both(board):
    device = opened(board)
    device.set(1.0, 0.0, 0)
    board.multiplexer.mask, board.multiplexer.is_stuck = 1 << 0, True  # so the second driver gets no command
    fails(device, "does not switch to channel 1; connected: 0", amplitude=0.0)
    board.until(silent)
    board.multiplexer.is_stuck = False
    device.close()


def test_a_multiplexer_that_was_reset_is_switched_again(board):
    device = opened(board)
    board.multiplexer.mask = 0
    device.set(1.0, 0.0, 0)
    assert board.now == (1.0, 1.0)
    device.close()


def test_a_board_that_was_reset_is_detected_and_its_drivers_are_silent_at_once_if_enabled_by_a_pin(board):
    device = opened(board)
    device.set(1.0, 0.0, 0)
    board.reset()
    assert silent(board)
    fails(device, "nothing answers")
    until_it_plays(device, board)
    device.close()


def test_drivers_that_are_not_enabled_any_more_are_noticed_though_they_answer(board):
    device = opened(board)
    board.values[7] = 0
    board.set_enabled()
    fails(device, "does not hold pin 7 high")
    until_it_plays(device, board)
    device.close()


def test_without_an_enable_pin_a_driver_outlives_the_reset_of_its_board_until_it_is_set_up_again(bare):
    device = opened(bare, "?motor=erm")
    device.set(1.0, 0.0, 0)
    bare.reset()
    assert bare.vibrates()
    fails(device, "nothing answers", amplitude=0.0)
    device.set(0.0, 0.0, 0)
    assert silent(bare)
    device.close()


def test_an_unplugged_board_is_reported_and_recovers(board):
    device = opened(board, TWO)
    board.enable_pin = None
    device.set(1.0, 0.0, 0)
    board.unplug()
    fails(device, f"{board.link} ")
    fails(device, "cannot be opened")
    board.plug()
    until_it_plays(device, board)
    device.close()


@pytest.mark.parametrize(("bit", "message"), [(1, "too much current"), (2, "is too hot")])
def test_a_driver_that_shuts_its_output_down_is_reported(board, bit, message):
    device = opened(board)
    board.drivers[1].is_faulty = bit
    fails(device, f"the driver on channel 1 .*{message}")
    board.drivers[1].is_faulty = 0
    device.close()


def test_a_response_without_content_is_an_error_of_the_device(board):
    device = opened(board)
    board.corrupts = True
    fails(device, "without content|does not respond")
    board.corrupts = False
    device.close()


# --- calibration ----------------------------------------------------------------------------------------


def test_a_calibration_measures_each_motor_and_ends_in_silence(board):
    device = opened(board, f"{ENABLED}&rated_v=2")
    results = device.calibrate()
    assert [result.text for result in results] == ["13-110-1", "13-110-1"]
    assert [round(result.resonance_hz) for result in results] == [175, 175]
    for driver in board.drivers.values():
        (registers,) = driver.calibrations
        assert registers[2] & 0x80  # as an LRA
        assert registers[6] & 0x31 == 0x30  # for a second, and not into the memory
        assert bytes(driver.registers[0x18:0x1A]) == bytes((13, 110))  # in use
        assert driver.registers[0x1A] & 3 == 1
    assert silent(board)
    device.set(1.0, 0.0, 0)
    assert board.now == (1.0, 1.0)
    device.close()


def test_a_calibration_is_restored_by_its_option_and_after_a_reset(board):
    device = opened(board, f"{ENABLED}&calibration=20-90-3,21-91-0")
    board.drivers[0].power_up()
    fails(device, "was reset")
    until_it_plays(device, board)
    assert [bytes(driver.registers[0x18:0x1A]) for driver in board.drivers.values()] == [
        b"\x14\x5a",
        b"\x15\x5b",
    ]
    assert [driver.registers[0x1A] & 3 for driver in board.drivers.values()] == [3, 0]
    device.close()


def test_a_calibration_without_a_motor_fails_and_leaves_silence(board):
    device = opened(board)
    board.drivers[1].has_motor = False
    with pytest.raises(
        DeviceError, match="the driver on channel 1 could not calibrate its motor; check its wires"
    ):
        device.calibrate()
    board.until(silent)
    device.close()


# --- what is refused ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("options", "problem"),
    [
        ("", "found motor=; give motor=lra"),
        ("?motor=coil", "found motor=coil; give motor=lra"),
        ("?motor=lra&channel=0,1", "every DRV2605L has the address 0x5A, so several need a multiplexer"),
        ("?motor=lra&mux=0x70", "a multiplexer needs the channels of the chips"),
        ("?motor=lra&mux=0x69&channel=0", "found mux=0x69; valid: 0x70 to 0x77"),
        ("?motor=lra&mux=0x70&channel=8", "found channel=8; valid: 0 to 7"),
        ("?motor=lra&mux=0x70&channel=0,", "found channel=; valid: 0 to 7"),
        ("?motor=lra&mux=0x70&channel=1,1", "found channel=1,1; name each channel once"),
        ("?motor=lra&hz=100", "found hz=100; valid: 140 to 300"),
        ("?motor=erm&hz=175", "hz is the resonance of an LRA"),
        ("?motor=lra&rated_v=nan", "found rated_v=nan; valid: 0.1 to 5.2"),
        ("?motor=erm&rated_v=3&clamp_v=2", "found clamp_v=2; a peak below 3.00 V would not allow"),
        ("?motor=lra&rated_v=4", "cannot drive 4 V with a peak of 5.65"),
        ("?motor=lra&enable=x", "found enable=x; valid: 0 to 127"),
        ("?motor=lra&calibration=1-2", "found calibration=1-2; valid: three numbers"),
        ("?motor=lra&calibration=1-2-4", "found calibration=1-2-4; valid: three numbers"),
        (f"{TWO}&calibration=1-2-3", "found 1 calibrations for 2 chips; give one for each"),
        ("?motor=lra&address=0x5A", "found address=0x5A; valid after the port: .motor=lra"),
        ("?motor=lra", "nothing answers at the I2C address 0x5a"),  # it is behind the multiplexer
        ("?motor=lra&mux=0x71&channel=0", "nothing answers at the I2C address 0x71"),
        ("?motor=lra&mux=0x70&channel=0,3", "nothing answers at the I2C address 0x5a"),
    ],
)
def test_an_unusable_argument_is_refused_in_one_sentence(board, options, problem):
    board.enable_pin = None
    board.set_enabled()
    with pytest.raises(BadInput, match=problem) as refused:
        Drv2605Device(f"{board.link}{options}")
    assert "\n" not in str(refused.value)
    assert silent(board)


def test_another_chip_at_the_address_is_refused(tmp_path):
    with DriverBoard(tmp_path / "tty", ()) as board:
        board.drivers[None].device_id = 3
        board.drivers[None].power_up()
        with pytest.raises(BadInput, match="is not a DRV2605L, whose device id is 7: found 3"):
            opened(board, "?motor=lra")


def test_a_board_without_i2c_is_refused(board):
    board.has_i2c = False
    with pytest.raises(BadInput, match="has no pins for I2C"):
        opened(board)


def test_a_pin_that_cannot_enable_is_refused(board, monkeypatch):
    monkeypatch.setattr(DriverBoard, "set_enabled", lambda board: None)
    monkeypatch.setattr(board, "values", {})
    monkeypatch.setattr(
        board,
        "handle",
        lambda master, command, data: command == 0x90 or DriverBoard.handle(board, master, command, data),
    )
    with pytest.raises(BadInput, match="does not hold pin 7 high, which enables the chips"):
        opened(board)
