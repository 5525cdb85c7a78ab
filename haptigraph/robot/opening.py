"""Open robots by name: simulated, crtk:PSM1, servo:NODE."""

from haptigraph.clock import Clock
from haptigraph.importing import chosen
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
    robot: Robot = chosen(ROBOTS, "robot", kind)(argument, clock)
    return robot
