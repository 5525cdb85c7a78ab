"""Memory growth of the loop: resident memory over many steps of the looped simulator at full speed.

Usage: python benchmarks/memory.py [STEPS]   (100,000 if not given; about an hour on two slow cores)
"""

import os
import sys
from pathlib import Path

from haptigraph import assemble
from haptigraph.config import load_config

PAGE = os.sysconf("SC_PAGE_SIZE")


def resident_mb() -> float:
    """Return the resident memory of this process [MB]."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * PAGE / 1e6


def main() -> None:
    """Run and print ten readings."""
    steps = int(sys.argv[1]) if len(sys.argv) > 1 else 100_000
    settings = ("source.uri=phantom:wrong_place_then_hit", "source.loop=true", "run.realtime=false")
    loop = assemble.build(load_config(None, settings))
    running = loop.steps()
    readings = {}
    for number, _ in enumerate(running, 1):
        if number % (steps // 10) == 0:
            percent = 100 * number // steps
            readings[percent] = resident_mb()
            print(f"{percent:4d} %  {number:7d} steps  {readings[percent]:7.1f} MB", flush=True)
        if number == steps:
            break
    running.close()
    growth = readings[100] - readings[10]
    print(f"growth from 10 % to 100 %: {growth:+.1f} MB at {loop.report.rate_hz:.1f} steps/s")


if __name__ == "__main__":
    main()
