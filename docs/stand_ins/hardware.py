"""Boards, driver chips and force devices: simulated ones, which answer as the real ones do."""

from contextlib import ExitStack
from pathlib import Path

from stand_ins.stand_in import StandIn  # isort: skip - sets the path

from firmata_board import Board
from haptic_driver import DriverBoard
from inverse_service import Service, serving


def arduino(folder: Path) -> StandIn:
    """A board with StandardFirmata at /dev/ttyACM0: it answers as the sketch does, at a pseudo-terminal."""
    board = Board(folder / ".ttyACM0")
    return StandIn(replaced={"/dev/ttyACM0": str(folder / ".ttyACM0")}, stop=board.close)


def driver_chip(folder: Path) -> StandIn:
    """A board with StandardFirmata at /dev/ttyACM0, and a DRV2605L on its I2C bus, EN at pin 7."""
    board = DriverBoard(folder / ".ttyACM0-chip", channels=(), enable_pin=7)
    return StandIn(replaced={"/dev/ttyACM0": str(folder / ".ttyACM0-chip")}, stop=board.close)


def driver_chips(folder: Path) -> StandIn:
    """Two DRV2605L, at channels 0 and 1 of a multiplexer, on the I2C bus of a board at /dev/ttyACM0."""
    board = DriverBoard(folder / ".ttyACM0-chips", channels=(0, 1))
    return StandIn(replaced={"/dev/ttyACM0": str(folder / ".ttyACM0-chips")}, stop=board.close)


def inverse3(folder: Path) -> StandIn:
    """A force device, inverse3: the service of its maker, simulated; its button is held."""
    stack, service = ExitStack(), Service()
    stack.enter_context(serving(service))
    service.buttons["a"] = True
    return StandIn(replaced={"inverse3": f"inverse3:{service.address}"}, stop=stack.close)
