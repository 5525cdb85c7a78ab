"""Force feedback: energy that random motions gain, limits, releases, stiffness, and what delay costs.

    python benchmarks/force.py [SESSIONS] [--seed N]

A session is eight random motions. Prints tables; exit code 1 if a bound does not hold. Three saboteurs (no
force, force of reversed sign, no energy tank) must break a bound.
"""

import argparse
import math
import os
import random
import sys
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from functools import partial

from force_motions import PERIOD_NS, ZERO, MakeRenderer, Outcome, session
from msgspec import Struct
from msgspec.structs import replace

from haptigraph.clock import VirtualClock
from haptigraph.haptics.force.fixture import Fixture
from haptigraph.haptics.force.interface import ForceCapabilities, HandReading
from haptigraph.haptics.force.renderer import ForceRenderer
from haptigraph.haptics.force.simulated import ARM, SimulatedForce, SimulatedHand
from haptigraph.robot.pose import Vec3

SESSIONS = 1250
SABOTEUR_SESSIONS = 25
PRESSES = 30
DELAYS_MS = (0, 10, 50)
TANK_MJ, RELEASE_MS, LEAST_STIFFNESS, MOST_PENETRATION, LEAST_FORCE_N = 5.0, 20.0, 0.8, 1.2, 0.2
STIFFNESSES_N_PER_MM = (0.1, 0.3, 1.0, 3.0, 5.0)
FAULTS = ("not a number", "stale", "jump", "too fast", "clutch", "no fixtures", "no images", "device")
DEADMAN_MS = 150


class NoForce(ForceRenderer):
    """A saboteur that never pushes."""

    def step(self, reading: HandReading, now_ns: int) -> Vec3:
        """Return nothing."""
        super().step(reading, now_ns)
        return ZERO


class Reversed(ForceRenderer):
    """A saboteur that pushes the wrong way, and does not know it."""

    def step(self, reading: HandReading, now_ns: int) -> Vec3:
        """Return the opposite."""
        x, y, z = super().step(reading, now_ns)
        return -x, -y, -z


class NoTank(ForceRenderer):
    """A saboteur whose energy is not limited."""

    def __init__(self, capabilities: ForceCapabilities) -> None:
        super().__init__(capabilities)
        self._tank.admitted_n = lambda *_: math.inf  # type: ignore[method-assign]


SABOTEURS = (NoForce, Reversed, NoTank)


class Report(Struct):
    """What was measured."""

    outcomes: dict[int, Outcome]
    """By delay [ms]."""
    releases_ms: dict[str, float]
    """The slowest, by fault."""
    stiffness: float
    """Felt, as a share of what was asked for; the worst, without delay."""
    penetration: float
    """At 1 N, as a multiple of F / k; the worst, without delay."""


class Press:
    """An arm that presses on a wall through a device with delay, cycle by cycle."""

    def __init__(self, make: MakeRenderer, wall: Fixture, delay_ms: int = 0) -> None:
        self.clock = VirtualClock(10**9)
        self.hand = SimulatedHand((0.0, 0.5, 0.0), ARM)
        self.device = SimulatedForce("", self.clock, self.hand)
        self.renderer = make(replace(self.device.capabilities, delay_ms=float(delay_ms)))
        self.fixtures: tuple[Fixture, ...] | None = (wall,)
        self._delayed = [ZERO] * delay_ms
        self.reading = self.device.exchange(ZERO)
        self.force_n = self.acting_n = ZERO
        self.cycles = 0

    def cycle(self, change: Callable[[HandReading], HandReading] = lambda reading: reading) -> None:
        """Do one cycle of 1 ms; the renderer gets the changed reading."""
        self.clock.wait_until(self.clock.now_ns() + PERIOD_NS)
        now_ns = self.clock.now_ns()
        if self.fixtures is not None and self.cycles % 33 == 0:
            self.renderer.take(self.fixtures, now_ns, now_ns)
        self.force_n = self.renderer.step(change(self.reading), now_ns)
        self._delayed.append(self.force_n)
        self.acting_n = self._delayed.pop(0)
        self.reading = self.device.exchange(self.acting_n)
        self.cycles += 1

    def hold(self, force_n: float, stiffness_n_per_mm: float, cycles: int) -> None:
        """Want to press with a force, approached within a third of the time."""
        depth_mm = force_n / ARM.stiffness_n_per_mm + force_n / stiffness_n_per_mm
        for cycle in range(cycles):
            share = min(3 * cycle / cycles, 1.0)
            self.hand.intended_mm = (0.0, 0.5 - (0.5 + depth_mm) * share, 0.0)
            self.cycle()

    def leave(self, cycles: int) -> None:
        """Go back above the wall."""
        self.hand.intended_mm = (0.0, 0.5, 0.0)
        for _ in range(cycles):
            self.cycle()


def plane(stiffness_n_per_mm: float) -> Fixture:
    """Return a wall below the hand."""
    return Fixture("plane", direction=(0.0, 1.0, 0.0), stiffness_n_per_mm=stiffness_n_per_mm, limit_n=4.0)


def felt(make: MakeRenderer, stiffness_n_per_mm: float, delay_ms: int = 0, presses: int = 1) -> float:
    """Return the stiffness felt at about 1 N, as a share of what was asked for, after some presses."""
    press = Press(make, plane(stiffness_n_per_mm), delay_ms)
    for number in range(presses):
        press.hold(1.0, stiffness_n_per_mm, 900 if number < presses - 1 else 1500)
        if number < presses - 1:
            press.leave(600)
    return press.acting_n[1] / max(-press.reading.position_mm[1], 1e-9) / stiffness_n_per_mm


def penetration(make: MakeRenderer, stiffness_n_per_mm: float) -> float:
    """Return how deep 1 N presses into a wall, as a multiple of F / k; infinite if it never pushes so."""
    press = Press(make, plane(stiffness_n_per_mm))
    press.hold(1.0, stiffness_n_per_mm, 900)
    for _ in range(400):  # a little further, slowly, until it is 1 N
        x, y, z = press.hand.intended_mm
        press.hand.intended_mm = (x, y - 0.002, z)
        press.cycle()
        if press.acting_n[1] >= 1.0:
            return -press.reading.position_mm[1] * stiffness_n_per_mm
    return math.inf


def release_ms(make: MakeRenderer, fault: str, seed: int) -> float:
    """Return how long after a fault the force is 0 for good; infinite if there was none, or it comes back."""
    rng = random.Random(seed)
    stiffness = rng.uniform(0.2, 3.0)
    press = Press(make, plane(stiffness))
    press.hold(rng.uniform(0.5, 3.0), stiffness, rng.randint(400, 700))
    if math.hypot(*press.force_n) < LEAST_FORCE_N:
        return math.inf
    frozen, spoil = press.reading, _spoiling(fault)
    if fault == "no fixtures":
        press.renderer.take((), press.clock.now_ns(), press.clock.now_ns())
        press.fixtures = ()
    if fault == "no images":
        press.fixtures = None
        press.renderer.take((plane(stiffness),), press.clock.now_ns(), press.clock.now_ns())
        for _ in range(DEADMAN_MS - 1):
            press.cycle()
    last_ms = 0.0
    for cycle in range(1, 200):
        if fault == "device":
            press.renderer.release("the device failed", press.clock.now_ns())
        press.cycle(lambda reading: frozen if fault == "stale" else spoil(reading))
        if press.force_n != ZERO:
            last_ms = cycle
    return last_ms + 1 if last_ms < 199 else math.inf


def _spoiling(fault: str) -> Callable[[HandReading], HandReading]:
    """Return what a fault does to a reading."""
    return {
        "not a number": lambda one: replace(one, position_mm=(math.nan, 0.0, 0.0)),
        "jump": lambda one: replace(one, position_mm=(one.position_mm[0] + one.stamp_ns % 7 + 3, -5.0, 0.0)),
        "too fast": lambda one: replace(one, velocity_mm_s=(600.0, 0.0, 0.0)),
        "clutch": lambda one: replace(one, engaged=False),
    }.get(fault, lambda one: one)


def measure(
    sessions: int, seed: int, make: MakeRenderer = ForceRenderer, workers: int = 1, releases: int = 20
) -> Report:
    """Measure everything that is bounded.

    Args:
        sessions: For each delay.
        seed: Of the first session.
        make: Makes the renderer.
        workers: Processes.
        releases: Tries for each fault.
    """
    outcomes = {}
    for delay_ms in DELAYS_MS:
        outcomes[delay_ms] = Outcome()
        one, seeds = partial(session, delay_ms=delay_ms, make=make), range(seed, seed + sessions)
        if workers > 1:
            with ProcessPoolExecutor(workers) as pool:
                found = list(pool.map(one, seeds, chunksize=20))
        else:
            found = [one(number) for number in seeds]
        for each in found:
            outcomes[delay_ms].add(each)
    return Report(
        outcomes,
        {fault: max(release_ms(make, fault, seed + n) for n in range(releases)) for fault in FAULTS},
        min(felt(make, stiffness) for stiffness in STIFFNESSES_N_PER_MM),
        max(penetration(make, stiffness) for stiffness in STIFFNESSES_N_PER_MM),
    )


def broken(report: Report) -> list[str]:
    """Return the bounds that do not hold, a phrase each."""
    found = []
    for delay_ms, outcome in report.outcomes.items():
        if outcome.energy_mj > TANK_MJ:
            found.append(f"energy: {outcome.energy_mj:.1f} mJ at {delay_ms} ms")
        if outcome.excess_n > 0:
            found.append(f"limit: exceeded by {outcome.excess_n:.3f} N at {delay_ms} ms")
        if outcome.most_n < LEAST_FORCE_N:
            found.append(f"vacuous: no more than {outcome.most_n:.2f} N at {delay_ms} ms")
    found += [
        f"release: {ms:g} ms after {fault}" for fault, ms in report.releases_ms.items() if ms > RELEASE_MS
    ]
    if report.stiffness < LEAST_STIFFNESS:
        found.append(f"stiffness: {report.stiffness:.2f} of what was asked for")
    if report.penetration > MOST_PENETRATION:
        found.append(f"penetration: {report.penetration:.2f} F/k at 1 N")
    return found


def main() -> None:
    """Measure, print, judge."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("sessions", nargs="?", type=int, default=SESSIONS)
    parser.add_argument("--seed", type=int, default=1_000_000)
    options = parser.parse_args()
    report = measure(options.sessions, options.seed, workers=min(os.cpu_count() or 1, 4))
    print(
        "| delay | motions | largest net energy | largest force | beyond its limit |\n|---|---|---|---|---|"
    )
    for delay_ms, one in report.outcomes.items():
        print(
            f"| {delay_ms} ms | {one.motions:,} | {one.energy_mj:.2f} mJ | {one.most_n:.2f} N "
            f"| {one.excess_n:.3f} N |"
        )
    print("\n| fault | force is 0 after |\n|---|---|")
    for fault, ms in report.releases_ms.items():
        print(f"| {fault} | {ms:g} ms |")
    print(f"\nstiffness felt at 0 ms: {report.stiffness:.3f} of what was asked for, at least")
    print(f"penetration at 1 N at 0 ms: {report.penetration:.3f} F/k, at most")
    print("\n| delay | asked for | felt in the first press | in the last of 30 |\n|---|---|---|---|")
    for delay_ms in DELAYS_MS:
        for stiffness in (0.1, 0.3, 1.0):
            first, later = (felt(ForceRenderer, stiffness, delay_ms, presses) for presses in (1, PRESSES))
            print(f"| {delay_ms} ms | {stiffness:g} N/mm | {first * 100:.0f} % | {later * 100:.0f} % |")
    problems = broken(report)
    for problem in problems:
        print(f"BROKEN {problem}")
    for make in SABOTEURS:
        few = measure(SABOTEUR_SESSIONS, options.seed, make, releases=1)
        found = broken(few)
        print(f"saboteur {make.__name__}: {'; '.join(found) or 'NOT FOUND'}")
        if not found:
            problems.append(make.__name__)
    if problems:
        sys.exit(1)


if __name__ == "__main__":
    main()
