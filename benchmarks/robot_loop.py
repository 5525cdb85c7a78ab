"""Jitter of a robot's loop at 200 Hz: alone, beside the loop of a run, and beside the live page in a browser.

    python benchmarks/robot_loop.py [--seconds 60]

Each is measured with real-time priority, which needs a permission, and without. Run it on an idle machine:
the results include the load of others, which it prints. The page needs Chromium.
"""

import argparse
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager, nullcontext
from pathlib import Path

from haptigraph.robot import process
from haptigraph.robot.process import RobotProcess
from haptigraph.teleop.motion import HandMotion

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "support"))
from live_bench import CHROMIUM, Live, chromium

SETUP = Path(__file__).parents[1] / "examples" / "robot.toml"
PHANTOM = "phantom:align_then_approach"
SETTLE_S = 3.0
HAND_S = 0.02
ORDINARY = [
    sys.executable,
    "-P",
    "-c",
    "from haptigraph.robot import loop; loop.raise_priority = lambda: None; loop.main()",
]


@contextmanager
def camera_loop() -> Iterator[None]:
    """Run the loop on a phantom, in real time."""
    command = [sys.executable, "-m", "haptigraph", "run", PHANTOM, "--set", "source.loop=true"]
    run = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        yield
        if run.poll() is not None:
            raise RuntimeError(f"the run has ended with {run.returncode}")
    finally:
        run.kill()
        run.wait()


@contextmanager
def live_page() -> Iterator[None]:
    """Run the loop on a phantom, shown by the live page in a browser."""
    with Live(PHANTOM) as live, chromium() as browser:
        page = browser.new_page()
        page.goto(live.url)
        yield


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
        status = robot.status()
    cycles = status.rate_hz * seconds
    share = 100 * status.missed_deadlines / cycles
    return (
        f"{status.late_p50_ms:8.3f} {status.late_p99_ms:8.3f} {status.late_p999_ms:8.3f} "
        f"{status.missed_deadlines:7} {share:8.3f} %  {status.rate_hz:6.1f} Hz"
    )


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=60.0)
    seconds = parser.parse_args().seconds
    process.MAX_REPORTS = 1_000_000
    beside = {"alone": nullcontext, "beside the loop of a run": camera_loop}
    if CHROMIUM:
        beside["beside the live page"] = live_page
    print(f"{seconds:g} s each; delay of a cycle in ms, of a period of 5 ms")
    print(f"{'':38} {'p50':>8} {'p99':>8} {'p99.9':>8} {'missed':>7} {'share':>10}  {'rate':>9}   load")
    for priority, program in (("real-time", process.PROGRAM), ("ordinary", ORDINARY)):
        process.PROGRAM = program
        for name, context in beside.items():
            with context():
                time.sleep(SETTLE_S)
                row = measure(seconds)
            print(f"{name + ', ' + priority:38} {row}   {os.getloadavg()[0]:.1f}", flush=True)


if __name__ == "__main__":
    main()
