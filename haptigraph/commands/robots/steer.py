"""The command `robot steer`: a hand moves a robot, from the terminal."""

import signal
import sys
from collections.abc import Iterator
from contextlib import closing, contextmanager, suppress
from typing import TYPE_CHECKING

import click

from haptigraph.commands.help import examples
from haptigraph.commands.robots.robot import SAFETY

if TYPE_CHECKING:
    from haptigraph.robot.interface import Operating, StateCommand
    from haptigraph.robot.messages import MotionStatus
    from haptigraph.robot.process import RobotProcess

__all__ = ["robot_steer"]

POLL_S = 0.05
ANSWER_S, BUSY_S = 1.0, 60.0


@click.command(
    "steer",
    epilog=examples(
        "haptigraph robot steer simulated --setup examples/robot.toml --leader keys",
        "haptigraph robot steer crtk:PSM1 --setup robot.toml --leader gamepad:0 --motion-scale 0.1",
    ),
)
@click.argument("uri", metavar="ROBOT")
@click.option(
    "--setup", required=True, metavar="FILE", help="Its robot.toml: where RCM and eye are, and limits."
)
@click.option(
    "--leader", required=True, metavar="LEADER", help="What the hand moves: keys, gamepad:0, joy, crtk:MTML."
)
@click.option("--motion-scale", type=click.FloatRange(0, 10), default=0.2, show_default=True, metavar="RATIO",
              help="Motion of the tool over motion of the hand.")  # fmt: skip
@click.option(
    "--tremor-filter/--no-tremor-filter", default=True, show_default=True, help="Remove 8 to 12 Hz."
)
def robot_steer(uri: str, setup: str, leader: str, motion_scale: float, *, tremor_filter: bool) -> None:
    """Move ROBOT by a leader, about its remote centre of motion and within the limits of FILE.

    Nothing moves before you type `on`. Ctrl-C switches motion off; so does everything that interrupts it, and
    then only `on` resumes it. Type enable, home, pause, resume or disable for the robot's own state, quit to
    end. Research software, not a medical device.
    """
    from haptigraph.robot.check_report import checked
    from haptigraph.robot.process import RobotProcess
    from haptigraph.teleop.motion import TeleopSettings

    checked(uri, setup)
    click.echo(SAFETY)
    settings = TeleopSettings(motion_scale=motion_scale, tremor_filter=tremor_filter)
    with _ended_by_signals(), closing(RobotProcess(uri, setup, settings)) as robot:
        _prompt(robot, leader)


def _prompt(robot: "RobotProcess", leader: str) -> None:
    """Execute typed lines until quit or their end."""
    from haptigraph.robot.interface import STATE_COMMANDS

    words = f"type on, {', '.join(STATE_COMMANDS)} or quit"
    click.echo(f"motion is off; {words}")
    for line in sys.stdin:
        word = line.strip()
        if word == "quit":
            return
        if word == "on":
            _steer(robot, leader)
        elif command := next((each for each in STATE_COMMANDS if each == word), None):
            _request(robot, command)
        elif word:
            click.echo(f"unknown: {word}; {words}")


def _request(robot: "RobotProcess", command: "StateCommand") -> None:
    """Ask for an operating state, and show what it becomes."""
    import time

    before = _operating(robot)
    robot.request(command)
    started_s = time.monotonic()
    while True:
        now = _operating(robot)
        limit_s = BUSY_S if now is not None and now.is_busy else 0.0 if now != before else ANSWER_S
        if time.monotonic() - started_s > limit_s:
            break
        time.sleep(POLL_S)
    homed = "" if now is None else "busy" if now.is_busy else "homed" if now.is_homed else "not homed"
    click.echo(f"the robot is {now.state}, {homed}" if now else "the robot reports no state")


def _steer(robot: "RobotProcess", leader: str) -> None:
    """Let the leader move the robot until Ctrl-C."""
    import time

    from haptigraph.clock import MonotonicClock
    from haptigraph.teleop.leaders.opening import open_leader
    from haptigraph.teleop.leaders.steering import Steering

    steering = Steering(leader, open_leader(leader, MonotonicClock()), robot.put, click.echo)
    before, known = "", 0
    with suppress(KeyboardInterrupt), closing(steering):
        click.echo("motion is on; Ctrl-C switches it off")
        robot.set_enabled(True)
        steering.start()
        try:
            while True:
                status = robot.status()
                problems = status.reading.problems if status.reading else ()
                for problem in problems[known:]:
                    click.echo(problem)
                known = len(problems)
                now = _motion(status)
                if now != before:
                    click.echo(now)
                    before = now
                time.sleep(POLL_S)
        finally:
            robot.set_enabled(False)
    click.echo("motion is off")


def _motion(status: "MotionStatus") -> str:
    if status.is_moving:
        return "moves with the hand"
    error = f" ({status.error})" if status.error else ""
    return f"held: {'; '.join(status.reasons)}{error}"


def _operating(robot: "RobotProcess") -> "Operating | None":
    reading = robot.reading
    return reading.operating if reading else None


@contextmanager
def _ended_by_signals() -> Iterator[None]:
    """End the program, not only the motion, on SIGTERM and when the terminal is closed."""
    endings = [getattr(signal, name) for name in ("SIGTERM", "SIGHUP") if hasattr(signal, name)]
    before = {number: signal.signal(number, lambda *_: sys.exit(1)) for number in endings}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
