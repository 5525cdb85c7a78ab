"""The robot of a run: [robot] settings -> its samples, and the text of its robot.toml.

It is only read, unless a page steers it.
"""

from functools import partial

from haptigraph.clock import Clock, MonotonicClock
from haptigraph.config import RobotConfig
from haptigraph.errors import BadInput
from haptigraph.messages import Fault, RobotSample
from haptigraph.robot.check_report import checked
from haptigraph.robot.listening import Listener, faults_of, sample_of
from haptigraph.robot.opening import open_robot
from haptigraph.robot.process import RobotProcess
from haptigraph.robot.setup import RobotSetup, parse_setup
from haptigraph.stages import RobotReadings, Source
from haptigraph.toml_document import Document

__all__ = ["SteeredRobot", "open_readings"]


class SteeredRobot:
    """The readings of a robot that a page steers: those of the process that moves it.

    Args:
        process: The robot; closed with this object.
        setup: Where the eye is, and the limits of motion.
        latency_ms: How much later than measured the robot stamps its poses.
    """

    def __init__(self, process: RobotProcess, setup: RobotSetup, latency_ms: float) -> None:
        self.process, self.setup, self._latency_ms = process, setup, latency_ms
        self._known = 0

    def take(self) -> tuple[RobotSample, ...]:
        """Return its measurements since the last call."""
        readings = self.process.take_readings()
        samples = (sample_of(reading, self.setup, self._latency_ms) for reading in readings)
        return tuple(sample for sample in samples if sample is not None)

    def take_faults(self) -> tuple[Fault, ...]:
        """Return what was wrong with the robot's messages since the last call."""
        reading = self.process.reading
        faults = faults_of(reading, self._known) if reading else []
        self._known += len(faults)
        return tuple(faults)

    def close(self) -> None:
        """Hold the robot, and end its process."""
        self.process.close()


def open_readings(config: RobotConfig, source: Source, clock: Clock) -> tuple[RobotReadings, str]:
    """Return the readings of a run's robot, and the text of its robot.toml; empty if there is none.

    Args:
        config: The [robot] settings.
        source: The opened source; a simulation or a recording may have readings of its own.
        clock: The run's.

    Raises:
        BadInput: If the robot or its file cannot be used.
    """
    if config.steer and not (config.uri and config.setup):
        raise BadInput("--steer needs --robot ROBOT and --robot-setup robot.toml")
    if not config.uri:
        raise BadInput("robot.setup goes with robot.uri (--robot)")
    if source.robot_setup is not None:
        raise BadInput("the source has robot readings of its own; leave out --robot")
    if not isinstance(clock, MonotonicClock):
        raise BadInput(f"{config.uri} works in real time; --fast is for files and the phantom")
    text = Document.read(config.setup).text if config.setup else ""
    setup = parse_setup(text, config.setup) if text else None
    if config.steer and setup is not None:
        checked(config.uri, config.setup)
        return SteeredRobot(RobotProcess(config.uri, config.setup), setup, config.latency_ms), text
    return Listener(partial(open_robot, config.uri), clock, setup, config.latency_ms), text
