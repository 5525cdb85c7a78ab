"""Jitter of the loop that renders force, at 1 kHz: alone, beside the loop of a run, and beside the live page.

    python benchmarks/force_loop.py [--seconds 60]

Each is measured with real-time priority, which needs a permission, and without, while a simulated hand is
pushed. Run it on an idle machine: the results include the load of others, which it prints. The page needs
Chromium.
"""

import time
from contextlib import closing

from jitter import CHROMIUM, ordinary, print_table, row_of

from haptigraph.config import HapticsConfig
from haptigraph.haptics.force import child, process
from haptigraph.haptics.force.fixture import Fixture
from haptigraph.haptics.force.loop import PERIOD_NS
from haptigraph.haptics.force.messages import ForceInput
from haptigraph.run_force import open_force

SETTLE_S = 3.0
STEP_S = 1 / 30
GUIDE = Fixture("cone", (0.0, 12.0, 0.0), (0.0, -1.0, 0.0), 1.7, stiffness_n_per_mm=0.3, limit_n=2.0)
FLOOR = Fixture("plane", (0.0, -1.0, 0.0), (0.0, 1.0, 0.0), stiffness_n_per_mm=1.0, limit_n=3.0)
DRAG = Fixture("viscous", damping_n_s_per_mm=0.01)
TIP_MM = 1.0, -0.5, 0.0  # beside the line, above the floor
PROGRAMS = {"real-time": child.PROGRAM, "ordinary": ordinary("haptigraph.haptics.force.loop")}


def use(priority: str) -> None:
    """Choose the priority of the next process."""
    child.PROGRAM = PROGRAMS[priority]


def measure(seconds: float) -> str:
    """Return one row: the jitter of the loop while three fixtures push a simulated hand."""
    with closing(open_force("simulated", HapticsConfig().deadman_ms)) as device:
        end_s = time.monotonic() + seconds
        while time.monotonic() < end_s:
            device.send(ForceInput((GUIDE, FLOOR, DRAG), TIP_MM, time.monotonic_ns(), 1.0))
            time.sleep(STEP_S)
        status = device.status()
        if not any(any(sample.force_n) for sample in device.take()):
            raise RuntimeError("the hand was never pushed")
    late_ms = status.late_p50_ms, status.late_p99_ms, status.late_p999_ms
    return row_of(late_ms, status.missed, seconds * 1e9 / PERIOD_NS, status.rate_hz)


def main() -> None:
    """Print the table."""
    process.MAX_REPORTS = 1_000_000
    print_table(__doc__, PERIOD_NS, use, measure, settle_s=SETTLE_S, has_page=bool(CHROMIUM))


if __name__ == "__main__":
    main()
