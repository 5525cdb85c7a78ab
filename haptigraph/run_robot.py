"""The robot of a run, which is only read: [robot] settings -> its samples, and the text of its robot.toml."""

from functools import partial

from haptigraph.clock import Clock, MonotonicClock
from haptigraph.config import RobotConfig
from haptigraph.errors import BadInput
from haptigraph.messages import RobotSample
from haptigraph.robot.listening import Listener, sample_of
from haptigraph.robot.opening import open_robot
from haptigraph.robot.process import RobotProcess
from haptigraph.robot.setup import RobotSetup, parse_setup
from haptigraph.stages import RobotReadings, Source
from haptigraph.toml_document import Document

__all__ = ["NoRobot", "SteeredReadings", "open_readings"]


class NoRobot:
    """The readings of a run without a robot, or whose source has them already."""

    def take(self) -> tuple[RobotSample, ...]:
        """Return nothing."""
        return ()

    def close(self) -> None:
        """Do nothing."""


class SteeredReadings:
    """The readings of a robot that a page steers; its owner closes it.

    Args:
        robot: The robot.
        setup: Where the eye is.
        latency_ms: How much later than measured the robot stamps its poses.
    """

    def __init__(self, robot: RobotProcess, setup: RobotSetup | None, latency_ms: float) -> None:
        self._robot, self._setup, self._latency_ms = robot, setup, latency_ms

    def take(self) -> tuple[RobotSample, ...]:
        """Return the measurements since the last call, oldest first."""
        samples = [
            sample_of(reading, self._setup, self._latency_ms) for reading in self._robot.take_readings()
        ]
        return tuple(sample for sample in samples if sample is not None)

    def close(self) -> None:
        """Do nothing."""


def open_readings(
    config: RobotConfig, source: Source, clock: Clock, steered: RobotProcess | None = None
) -> tuple[RobotReadings, str]:
    """Return the readings of a run's robot, and the text of its robot.toml; empty if there is none.

    Args:
        config: The [robot] settings.
        source: The opened source; a simulation or a recording may have readings of its own.
        clock: The run's.
        steered: The same robot, if a page steers it.

    Raises:
        BadInput: If the robot or its file cannot be used.
    """
    if not config.uri:
        if config.setup:
            raise BadInput("robot.setup goes with robot.uri (--robot)")
        return NoRobot(), source.robot_setup or ""
    if source.robot_setup is not None:
        raise BadInput("the source has robot readings of its own; leave out --robot")
    if not isinstance(clock, MonotonicClock):
        raise BadInput(f"{config.uri} works in real time; --fast is for files and the phantom")
    text = Document.read(config.setup).text if config.setup else ""
    setup = parse_setup(text, config.setup) if text else None
    if steered is not None:
        return SteeredReadings(steered, setup, config.latency_ms), text
    return Listener(partial(open_robot, config.uri), clock, setup, config.latency_ms), text
