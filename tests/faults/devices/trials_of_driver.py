"""Faults between the real program and the motors of two simulated DRV2605L, judged by what the motors get."""

import os
import random
import signal
import time
from itertools import pairwise
from pathlib import Path

from fault_rig import DEADMAN_MS, ENABLE_PIN, PERIOD_MS, TIMEOUT_S, Rig
from haptic_driver import DriverBoard
from trials import HUNG_MS, KILLED_MS, Measured, judge_end, judge_silence, promise

LIMIT_MS = DEADMAN_MS + PERIOD_MS["drv2605"]
WATCHED_S = 2.5
MAX_PULSE_S, MAX_PULSED_SHARE = 0.1, 0.1
"""While a chip cannot be reached, it may get a pulse each time it is enabled to be tried again."""
ENDS = ("SIGKILL", "SIGSTOP", "SIGINT", "SIGTERM", "SIGHUP")
ENABLED = ("a chip does not listen", "the multiplexer is stuck", "the board is reset")
"""Only with EN wired to a pin does anything reach the chips, or fall with the board."""
FAULTS = (
    *ENABLED,
    "a chip is reset",
    "the chips lose power",
    "the board does not answer",
    "the cable is pulled",
)


def begin(fault: str, rng: random.Random, board) -> None:
    """Break something."""
    driver = board.drivers[rng.choice((0, 1))]
    if fault == "a chip does not listen":
        driver.answers = False
    elif fault == "the multiplexer is stuck":
        board.multiplexer.is_stuck = True
        board.multiplexer.mask = rng.choice((0, 1, 2, 1 << rng.randrange(2, 8)))
    elif fault == "the board is reset":
        board.restart(rng.uniform(0, 2))
    elif fault == "a chip is reset":
        driver.power_up()
    elif fault == "the chips lose power":
        for each in board.drivers.values():
            each.lose_power()
    elif fault == "the board does not answer":
        board.responds = False
    else:
        board.unplug()


def end(fault: str, board) -> None:
    """Repair it."""
    board.multiplexer.is_stuck, board.responds = False, True
    if fault == "the cable is pulled":
        board.plug()
    for driver in board.drivers.values():
        driver.answers = True
        if not driver.has_power:
            driver.power_up()


def until_it_vibrates_steadily(rig: Rig, rng: random.Random) -> None:
    """Wait until a random time at which it vibrates."""
    rig.until_vibrating()
    until_recovered(rig)
    time.sleep(rng.uniform(0, 0.5))
    rig.monitor.until(vibrates=True)


def until_recovered(rig: Rig) -> None:
    """Wait until the run has accepted the answers to a command that vibrates."""
    rig.monitor.board.until(DriverBoard.is_recovered, TIMEOUT_S)


def first_silence(rig: Rig, began_ns: int) -> int:
    """Wait for the first silence since a time, or return it if it was silent just then."""
    if not next((level for at_ns, level in reversed(rig.monitor.edges) if at_ns <= began_ns), 0):
        return began_ns  # other work on the machine has delayed an image
    return rig.monitor.until_silent_once(began_ns)


def judge_pulses(rig: Rig, what: str, silent_ns: int) -> None:
    """Check that nothing is felt while the fault lasts, apart from short and rare pulses."""
    time.sleep(WATCHED_S)
    edges = [*rig.monitor.edges, (time.monotonic_ns(), 0)]
    pulses_s = [
        (after_ns - at_ns) / 1e9
        for (at_ns, level), (after_ns, _) in pairwise(edges)
        if level and at_ns >= silent_ns
    ]
    busy_s = rig.probe.late_ms(silent_ns, time.monotonic_ns()) / 1e3
    promise(
        max(pulses_s, default=0) <= MAX_PULSE_S + busy_s
        and sum(pulses_s) <= MAX_PULSED_SHARE * WATCHED_S + busy_s,
        f"{what}: {len(pulses_s)} pulses of {max(pulses_s, default=0) * 1e3:.0f} ms or less in {WATCHED_S} s",
    )


def driver_chip(rng: random.Random, folder: Path) -> Measured:
    """A chip, the multiplexer, the board, the cable or the run fails."""
    what = rng.choice((*FAULTS, *ENDS, "a chip does not listen at the end"))
    enable_pin = ENABLE_PIN if what in ENABLED or rng.random() < 0.5 else None
    if what == "a chip does not listen at the end":
        return unreachable_at_the_end(rng, folder)
    with Rig(folder, "drv2605", enable_pin=enable_pin) as rig:
        until_it_vibrates_steadily(rig, rng)
        if what in ENDS:
            return ended(rig, what)
        began_ns = time.monotonic_ns()
        begin(what, rng, rig.monitor.board)
        silent_ns = first_silence(rig, began_ns)
        silence_ms = judge_silence(rig, what, began_ns, silent_ns, LIMIT_MS)
        rig.until_output("! device: ")
        if what in ("a chip does not listen", "the multiplexer is stuck", "the board does not answer"):
            judge_pulses(rig, what, silent_ns)
        end(what, rig.monitor.board)
        until_recovered(rig)
        rig.signal(signal.SIGINT)
        judge_end(rig)
        promise(not rig.monitor.vibrates, f"{what}: vibrates after the end")
        return Measured(what, silence_ms)


def ended(rig: Rig, how: str) -> Measured:
    """The run is killed, stopped or ended."""
    number = getattr(signal, how)
    began_ns = rig.signal(number)
    silence_ms = judge_silence(rig, how, began_ns, max(rig.monitor.until(vibrates=False), began_ns), LIMIT_MS)
    if number == signal.SIGSTOP:
        rig.signal(signal.SIGKILL)
    judge_end(rig, code=-signal.SIGKILL if number in (signal.SIGKILL, signal.SIGSTOP) else 0)
    return Measured(how, silence_ms)


def unreachable_at_the_end(rng: random.Random, folder: Path) -> Measured:
    """A chip whose EN is not wired to a pin does not listen when the run ends: nothing can silence it."""
    what = "a chip does not listen at the end"
    with Rig(folder, "drv2605") as rig:
        until_it_vibrates_steadily(rig, rng)
        begin("a chip does not listen", rng, rig.monitor.board)
        rig.signal(signal.SIGINT)
        last = judge_end(rig, code=2).splitlines()[-1]
        promise(
            "does not confirm silence; it may still vibrate" in last, f"{what}: the last line is {last!r}"
        )
        return Measured(what)


def restarts(rng: random.Random, folder: Path) -> Measured:
    """The device's process hangs or is killed, or a board restarts to which EN is not wired."""
    what = rng.choice(("the process hangs", "the process is killed", "the board restarts, EN is not wired"))
    with Rig(folder, "drv2605") as rig:
        until_it_vibrates_steadily(rig, rng)
        began_ns = time.monotonic_ns()
        if what == "the board restarts, EN is not wired":
            boot_s = rng.uniform(0, 3)
            rig.monitor.board.restart(boot_s)
            limit_ms = 1e3 * boot_s + HUNG_MS
        else:
            os.kill(rig.watchdog(), signal.SIGSTOP if what == "the process hangs" else signal.SIGKILL)
            limit_ms = HUNG_MS if what == "the process hangs" else KILLED_MS
        silent_ns = first_silence(rig, began_ns)
        silence_ms = judge_silence(rig, what, began_ns, silent_ns, limit_ms)
        rig.monitor.until(vibrates=True)
        rig.signal(signal.SIGINT)
        judge_end(rig)
        promise(not rig.monitor.vibrates, f"{what}: vibrates after the end")
        return Measured(what, silence_ms)
