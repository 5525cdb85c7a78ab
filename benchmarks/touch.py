"""Timing of haptic patterns on a serial board: every edge compared with its due time.

Plays patterns as a run does (guard, player, device process, Firmata over a pseudo-terminal) to a board that
decodes commands and records their times: those of a PWM pin (`serial`), or of two DRV2605L behind a
multiplexer (`drv2605`). Measures the round trip of a command, too. Needs an idle machine.

Usage: python benchmarks/touch.py [SECONDS] [--device drv2605]   (60 s, `serial` if not given)
"""

import argparse
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "support"))
sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "support" / "boards"))

from firmata_board import Board
from haptic_driver import DriverBoard
from helpers import PULSE, SUCCESS, make_step

from haptigraph.assemble import open_device
from haptigraph.clock import MonotonicClock
from haptigraph.config import HapticsConfig
from haptigraph.haptics.guard import Guard
from haptigraph.haptics.player import Player
from haptigraph.messages import OFF, Pattern

IMAGE_NS = 33_000_000
BOARDS = {  # makes a board that appends (stamp_ns, output) of every change to a list; the device's options
    "serial": (lambda link, seen: Board(link, on_change=lambda at, _, value: seen.append((at, value))), ""),
    "drv2605": (
        lambda link, seen: DriverBoard(link, (0, 1), felt=lambda *edge: seen.append(edge)),
        "?motor=lra&mux=0x70&channel=0,1",
    ),
}


def play(player: Player, pattern: Pattern, length_s: float) -> int:
    """Send a pattern at the rate of images; return its start [ns]."""
    clock = MonotonicClock()
    start_ns = now_ns = clock.now_ns()
    while now_ns < start_ns + length_s * 1e9:
        player.send(make_step(pattern, stamp_ns=now_ns, since_ns=start_ns), now_ns)
        clock.wait_until(now_ns + IMAGE_NS)
        now_ns = clock.now_ns()
    return start_ns


def edge_errors_ms(seen: list[tuple[int, float]], start_ns: int, pattern: Pattern, edges: int) -> list[float]:
    """Return the time errors of the first edges, each to the nearest edge of its direction."""
    recorded = {True: [], False: []}  # on, off
    for stamp_ns, value in seen:
        recorded[bool(value)].append(stamp_ns)
    period_ns = (pattern.on_ms + pattern.off_ms) * 1e6
    errors = []
    for number in range(edges):
        period, is_off = divmod(number, 2)
        due_ns = start_ns + period * period_ns + is_off * pattern.on_ms * 1e6
        errors.append(min(abs(stamp_ns - due_ns) for stamp_ns in recorded[not is_off]) / 1e6)
    return errors


def main() -> None:
    """Play pulses, then bursts, and print the percentiles."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("seconds", type=float, nargs="?", default=60.0)
    parser.add_argument("--device", choices=BOARDS, default="serial")
    options = parser.parse_args()
    seconds, seen = options.seconds, []
    make_board, arguments = BOARDS[options.device]
    with tempfile.TemporaryDirectory() as folder, make_board(Path(folder) / "tty", seen) as board:
        device = open_device(f"{options.device}:{board.link}{arguments}")
        round_trips: list[float] = []
        send = device.set

        def timed(amplitude: float, frequency_hz: float, stamp_ns: int) -> None:
            start_s = time.perf_counter()
            send(amplitude, frequency_hz, stamp_ns)
            round_trips.append((time.perf_counter() - start_s) * 1e3)

        device.set = timed  # type: ignore[method-assign]
        player = Player(Guard(device, HapticsConfig()), MonotonicClock())
        errors: dict[str, list[float]] = {"pulses": [], "bursts": []}
        start_ns = play(player, PULSE, seconds)
        play(player, OFF, 0.5)
        errors["pulses"] = edge_errors_ms(seen, start_ns, PULSE, int(seconds / 0.16) * 2)
        for _ in range(max(int(seconds / 6), 1)):
            start_ns = play(player, SUCCESS, 0.3)
            play(player, OFF, 0.3)
            errors["bursts"] += edge_errors_ms(seen, start_ns, SUCCESS, 4)
        player.close()
    for name, values in (*errors.items(), ("round trip", round_trips)):
        p50, p99, maximum = np.percentile(values, [50, 99, 100])
        print(f"{name:11} {len(values):5d}  p50 {p50:6.2f} ms  p99 {p99:6.2f} ms  max {maximum:6.2f} ms")


if __name__ == "__main__":
    main()
