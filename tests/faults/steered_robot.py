"""Programs for faults of real processes: a robot whose commands are logged, and a program that steers it.

python steered_robot.py traced:LOG ROBOT.TOML    the robot's process, as `haptigraph.robot.loop` is
python steered_robot.py steer URI ROBOT.TOML     the program: prints its state whenever it changes
"""

import os
import sys
import time

from haptigraph.clock import Clock
from haptigraph.robot import loop, opening, process
from haptigraph.robot.gate import LATCHED
from haptigraph.robot.pose import ToolPose
from haptigraph.robot.simulated import SimulatedRobot
from haptigraph.teleop.motion import HandMotion, TeleopSettings

PERIOD_S = 0.01


class TracedRobot(SimulatedRobot):
    """A simulated robot, enabled and homed, that writes every command to a file at once."""

    def __init__(self, argument: str, clock: Clock) -> None:
        super().__init__("1", clock)
        self._log = os.open(argument, os.O_WRONLY | os.O_APPEND | os.O_CREAT)
        self.request("enable")
        self.request("home")

    def _note(self, *words: object) -> None:
        os.write(self._log, " ".join(map(str, (time.monotonic_ns(), *words, "\n"))).encode())

    def move(self, pose: ToolPose, stamp_ns: int) -> None:
        self._note("move", *pose.position_mm)
        super().move(pose, stamp_ns)

    def hold(self, stamp_ns: int) -> None:
        self._note("hold")
        super().hold(stamp_ns)

    def close(self) -> None:
        self._note("close")


def steer(uri: str, setup: str) -> None:
    """Switch on when the robot is ready, and move it without end, slowly to and fro.

    If it is interrupted before it ever moved, switch off and on again, as an operator would.
    """
    process.PROGRAM = [sys.executable, __file__]
    robot = process.RobotProcess(uri, setup, TeleopSettings(motion_scale=1.0, tremor_filter=False))
    before, number, has_moved = "", 0, False
    while True:
        time.sleep(PERIOD_S)
        number += 1
        robot.put(HandMotion(number > 20, 0.01 if number // 200 % 2 else -0.01))
        status = robot.status()
        reading = status.reading
        is_ready = reading is not None and reading.operating is not None and reading.operating.is_homed
        has_moved |= status.is_moving
        if is_ready and not status.is_switched_on:
            robot.set_enabled(True)
        elif LATCHED in status.reasons and not has_moved:
            robot.set_enabled(False)
        line = f"{robot._process.pid} {'moving' if status.is_moving else '; '.join(status.reasons)}"
        if line != before:
            sys.stdout.write(line + "\n")
            sys.stdout.flush()
            before = line


if __name__ == "__main__":
    if sys.argv[1] == "steer":
        steer(*sys.argv[2:])
    else:
        opening.ROBOTS["traced"] = "__main__:TracedRobot"
        loop.main()
