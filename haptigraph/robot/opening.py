"""Open robots by name: simulated, crtk:PSM1, servo:NODE."""

from importlib import import_module

from haptigraph.clock import Clock
from haptigraph.errors import BadInput, unknown_name
from haptigraph.robot.interface import Robot

__all__ = ["ROBOTS", "open_robot"]

ROBOTS = {
    "crtk": "haptigraph.robot.ros.crtk:CrtkRobot",
    "servo": "haptigraph.robot.ros.servo:ServoRobot",
    "simulated": "haptigraph.robot.simulated:SimulatedRobot",
}


def open_robot(uri: str, clock: Clock) -> Robot:
    """Open a robot by NAME or NAME:ARGUMENT.

    Args:
        uri: The robot.
        clock: The run's; stamps its readings.

    Raises:
        BadInput: If there is no such robot, or it cannot be opened.
        MissingExtra: If its library is not installed.
    """
    kind, _, argument = uri.partition(":")
    if kind not in ROBOTS:
        raise BadInput(unknown_name("robot", kind, ROBOTS))
    module, _, name = ROBOTS[kind].partition(":")
    robot: Robot = getattr(import_module(module), name)(argument, clock)
    return robot
