"""Bring a robot into the state in which it can be moved."""

from collections.abc import Callable

from haptigraph.clock import Clock
from haptigraph.errors import DeviceError
from haptigraph.robot.interface import Operating, StateCommand
from haptigraph.robot.process import RobotProcess

__all__ = ["enable_and_home"]

ENABLE_S, HOME_S, POLL_S = 10.0, 60.0, 0.05


def enable_and_home(robot: RobotProcess, clock: Clock) -> None:
    """Enable a robot and let it find its home, unless it has; it may move by itself meanwhile.

    Raises:
        DeviceError: If it does not reach that state in time.
    """
    _reach(robot, clock, "enable", lambda operating: operating.state == "ENABLED", ENABLE_S)
    _reach(robot, clock, "home", lambda operating: operating.is_homed and not operating.is_busy, HOME_S)


def _reach(
    robot: RobotProcess,
    clock: Clock,
    command: StateCommand,
    is_there: Callable[[Operating], bool],
    within_s: float,
) -> None:
    give_up_ns, is_asked = clock.now_ns() + round(within_s * 1e9), False
    while True:
        reading = robot.reading
        operating = reading.operating if reading else None
        if operating is not None and is_there(operating):
            return
        if clock.now_ns() > give_up_ns:
            found = (
                f"{operating.state}, {'' if operating.is_homed else 'not '}homed" if operating else "unknown"
            )
            raise DeviceError(
                f"{robot.uri}: {command} was not done within {within_s:g} s; its state is {found}"
            )
        if operating is not None and not is_asked:
            robot.request(command)
            is_asked = True
        clock.wait_until(clock.now_ns() + round(POLL_S * 1e9))
