"""Jitter of a robot's loop at 200 Hz: alone, beside the loop of a run, and beside the live page in a browser.

    python benchmarks/robot_loop.py [--seconds 60]

Each is measured with real-time priority, which needs a permission, and without. Run it on an idle machine:
the results include the load of others, which it prints. The page needs Chromium.
"""

import time
from contextlib import closing
from pathlib import Path

from jitter import CHROMIUM, ordinary, print_table, row_of

from haptigraph.robot import process
from haptigraph.robot.controller import RATE_HZ
from haptigraph.robot.loop import PERIOD_NS
from haptigraph.robot.process import RobotProcess
from haptigraph.teleop.motion import HandMotion

SETUP = Path(__file__).parents[1] / "examples" / "robot.toml"
SETTLE_S = 3.0
HAND_S = 0.02
PROGRAMS = {"real-time": process.PROGRAM, "ordinary": ordinary("haptigraph.robot.loop")}


def use(priority: str) -> None:
    """Choose the priority of the next process."""
    process.PROGRAM = PROGRAMS[priority]


def measure(seconds: float) -> str:
    """Return one row: the jitter of the loop while a hand moves a simulated robot."""
    with closing(RobotProcess("simulated:1", SETUP)) as robot:
        for command in ("enable", "home"):
            robot.request(command)
        time.sleep(1.0)
        robot.set_enabled(True)
        end_s, number = time.monotonic() + seconds, 0
        while time.monotonic() < end_s:
            number += 1
            robot.put(HandMotion(number > 5, 0.5 if number // 100 % 2 else -0.5))
            time.sleep(HAND_S)
        while not (status := robot.status()).rate_hz:  # this program, too, may get the processor late
            time.sleep(HAND_S)
    late_ms = status.late_p50_ms, status.late_p99_ms, status.late_p999_ms
    return row_of(late_ms, status.missed_deadlines, RATE_HZ * seconds, status.rate_hz)


def main() -> None:
    """Print the table."""
    process.MAX_REPORTS = 1_000_000
    print_table(__doc__, PERIOD_NS, use, measure, settle_s=SETTLE_S, has_page=bool(CHROMIUM))


if __name__ == "__main__":
    main()
