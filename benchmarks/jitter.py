"""What the benchmarks of loops in processes of their own share: what else runs beside them, and the table."""

import argparse
import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "support"))
from live_bench import CHROMIUM, Live, chromium

__all__ = ["CHROMIUM", "camera_loop", "live_page", "ordinary", "print_table", "row_of"]

PHANTOM = "phantom:align_then_approach"
CLOCK = """
import sys, time
from haptigraph.child_process import raise_priority
from haptigraph.clock import Cycles, MonotonicClock, lateness_ms
if sys.argv[3] == "real-time":
    raise_priority()
clock, late_ns = MonotonicClock(), []
cycles, begun_ns = Cycles(clock, int(sys.argv[1])), clock.now_ns()
now_ns, end_ns = begun_ns, begun_ns + float(sys.argv[2]) * 1e9
while now_ns < end_ns:
    now_ns, one_ns = cycles.wait()
    late_ns.append(one_ns)
print(*lateness_ms(late_ns), cycles.missed, len(late_ns) / ((now_ns - begun_ns) / 1e9))
"""


def ordinary(module: str) -> list[str]:
    """Return the command of a loop's program, but without real-time priority."""
    program = f"import {module} as loop; loop.raise_priority = lambda: None; loop.main()"
    return [sys.executable, "-P", "-c", program]


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


def clock_row(period_ns: int, seconds: float, priority: str) -> str:
    """Return the row of a process that does nothing but wait for each cycle: the limit of the machine."""
    command = [sys.executable, "-c", CLOCK, str(period_ns), str(seconds), priority]
    result = subprocess.run(command, check=True, capture_output=True, text=True)
    p50_ms, p99_ms, p999_ms, missed, rate_hz = map(float, result.stdout.split())
    return row_of((p50_ms, p99_ms, p999_ms), int(missed), seconds * 1e9 / period_ns, rate_hz)


def print_table(
    description: str | None,
    period_ns: int,
    use: Callable[[str], None],
    measure: Callable[[float], str],
    *,
    settle_s: float,
    has_page: bool,
) -> None:
    """Measure alone, beside a run and beside the live page, with real-time priority and without.

    The program's arguments say for how many seconds each.

    Args:
        description: Of the program.
        period_ns: Of a cycle.
        use: Called with "real-time" or "ordinary", the priority of the next processes.
        measure: Takes the seconds and returns a row: p50, p99, p99.9, missed cycles, their share, rate.
        settle_s: What runs beside settles for this time.
        has_page: Whether to measure beside the live page, too.
    """
    parser = argparse.ArgumentParser(description=description)
    parser.add_argument("--seconds", type=float, default=60.0)
    seconds = parser.parse_args().seconds
    beside = {"alone": nullcontext, "beside the loop of a run": camera_loop}
    if has_page:
        beside["beside the live page"] = live_page
    print(f"{seconds:g} s each; delay of a cycle in ms, of a period of {period_ns / 1e6:g} ms")
    print(f"{'':38} {'p50':>8} {'p99':>8} {'p99.9':>8} {'missed':>7} {'share':>10}  {'rate':>9}   load")
    for priority in ("real-time", "ordinary"):
        use(priority)
        row = clock_row(period_ns, seconds, priority)
        print(f"{'clock alone, ' + priority:38} {row}   {os.getloadavg()[0]:.1f}", flush=True)
        for name, context in beside.items():
            with context():
                time.sleep(settle_s)
                row = measure(seconds)
            print(f"{name + ', ' + priority:38} {row}   {os.getloadavg()[0]:.1f}", flush=True)


def row_of(late_ms: tuple[float, float, float], missed: int, cycles: float, rate_hz: float) -> str:
    """Return a row of the table."""
    p50_ms, p99_ms, p999_ms = late_ms
    share = 100 * missed / cycles
    return f"{p50_ms:8.3f} {p99_ms:8.3f} {p999_ms:8.3f} {missed:7} {share:8.3f} %  {rate_hz:6.1f} Hz"
