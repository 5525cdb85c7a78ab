"""How well a board on a serial port keeps the haptic grammar's time: every edge there against the plan.

Plays patterns as a run does (guard, player, a process that keeps the device, Firmata over a pseudo-terminal)
to a board that decodes and stamps what arrives. Says also how long a command takes there and back.
Run it on a quiet machine.

Usage: python benchmarks/touch.py [SECONDS]   (60 if not given)
"""

import sys
import tempfile
import time
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "support"))

from firmata_board import Board
from helpers import PULSE, SUCCESS, make_step

from haptigraph.assemble import open_device
from haptigraph.clock import MonotonicClock
from haptigraph.config import HapticsConfig
from haptigraph.haptics.guard import Guard
from haptigraph.haptics.player import Player
from haptigraph.messages import OFF, Pattern

NEWS_NS = 33_000_000


def play(player: Player, pattern: Pattern, length_s: float) -> int:
    """Send a pattern as often as images come; return when it began [ns]."""
    clock = MonotonicClock()
    began_ns = now_ns = clock.now_ns()
    while now_ns < began_ns + length_s * 1e9:
        player.send(make_step(pattern, stamp_ns=now_ns, since_ns=began_ns), now_ns)
        clock.wait_until(now_ns + NEWS_NS)
        now_ns = clock.now_ns()
    return began_ns


def lateness_ms(board: Board, began_ns: int, pattern: Pattern, edges: int) -> list[float]:
    """Return how far from its due moment each of the first edges came, the nearest of its direction."""
    came = {True: [], False: []}  # on, off
    for stamp_ns, _, value in board.edges:
        came[bool(value)].append(stamp_ns)
    period_ns = (pattern.on_ms + pattern.off_ms) * 1e6
    late = []
    for number in range(edges):
        turn, is_off = divmod(number, 2)
        due_ns = began_ns + turn * period_ns + is_off * pattern.on_ms * 1e6
        late.append(min(abs(stamp_ns - due_ns) for stamp_ns in came[not is_off]) / 1e6)
    return late


def main() -> None:
    """Play pulses, then bursts, and print the percentiles."""
    seconds = float(sys.argv[1]) if len(sys.argv) > 1 else 60.0
    with tempfile.TemporaryDirectory() as folder, Board(Path(folder) / "tty") as board:
        device = open_device(f"serial:{board.link}")
        told: list[float] = []
        tell = device.set

        def timed(amplitude: float, frequency_hz: float, stamp_ns: int) -> None:
            begun_s = time.perf_counter()
            tell(amplitude, frequency_hz, stamp_ns)
            told.append((time.perf_counter() - begun_s) * 1e3)

        device.set = timed  # type: ignore[method-assign]
        player = Player(Guard(device, HapticsConfig()), MonotonicClock())
        late: dict[str, list[float]] = {"pulses": [], "bursts": []}
        began_ns = play(player, PULSE, seconds)
        play(player, OFF, 0.5)
        late["pulses"] = lateness_ms(board, began_ns, PULSE, int(seconds / 0.16) * 2)
        for _ in range(max(int(seconds / 6), 1)):
            began_ns = play(player, SUCCESS, 0.3)
            play(player, OFF, 0.3)
            late["bursts"] += lateness_ms(board, began_ns, SUCCESS, 4)
        player.close()
    for name, values in (*late.items(), ("round trip", told)):
        p50, p99, most = np.percentile(values, [50, 99, 100])
        print(f"{name:11} {len(values):5d}  p50 {p50:6.2f} ms  p99 {p99:6.2f} ms  most {most:6.2f} ms")


if __name__ == "__main__":
    main()
