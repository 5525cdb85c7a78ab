"""A program that steers a robot without end, slowly to and fro, and can be killed or stopped.

steering.py URI ROBOT.TOML; prints the process of the loop, and whether it moves, when that changes.
"""

import sys
import time

from haptigraph.robot.process import RobotProcess
from haptigraph.teleop.motion import HandMotion, TeleopSettings

PERIOD_S = 0.01
STEP_MM = 0.04
SWITCHED = 100  # messages between attempts to switch on


def main():
    uri, setup = sys.argv[1:]
    robot = RobotProcess(uri, setup, TeleopSettings(motion_scale=1.0))
    number, before = 0, ""
    while True:
        time.sleep(PERIOD_S)
        number += 1
        status = robot.status()
        if number % SWITCHED == 0 and not status.is_moving:
            robot.request("enable")
            robot.request("home")
            robot.set_enabled(False)
            robot.set_enabled(True)
        robot.put(HandMotion(True, STEP_MM if number // 150 % 2 else -STEP_MM))
        line = f"{robot._process.pid} {'moving' if status.is_moving else '; '.join(status.reasons)}"
        if line != before:
            sys.stdout.write(line + "\n")
            sys.stdout.flush()
            before = line


if __name__ == "__main__":
    main()
