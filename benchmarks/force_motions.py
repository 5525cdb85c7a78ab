"""Random hands that touch random fixtures through a force device with delay, and the energy they receive.

Used by `force.py` and its tests. Everything is deterministic: one seed, one session.
"""

import math
import random
from collections import deque
from collections.abc import Callable
from typing import Protocol

from msgspec import Struct
from msgspec.structs import replace

from haptigraph.haptics.force.fixture import Fixture
from haptigraph.haptics.force.interface import ForceCapabilities, HandReading
from haptigraph.haptics.force.renderer import ForceRenderer
from haptigraph.haptics.force.simulated import ArmImpedance, SimulatedForce, SimulatedHand
from haptigraph.robot.pose import Vec3

MOTIONS_PER_SESSION = 8
MOTION_MS, START_MS, IMAGE_MS = 160, 220, 33
PERIOD_NS = 1_000_000
ZERO: Vec3 = (0.0, 0.0, 0.0)
MAX_SPEED_MM_S = SimulatedForce.capabilities.max_speed_mm_s
SPEED_MM_S = 0.9 * MAX_SPEED_MM_S  # of driven hands: below the limit in spite of noise

MakeRenderer = Callable[[ForceCapabilities], ForceRenderer]


class Hand(Protocol):
    """What the device pushes."""

    position_mm: Vec3
    velocity_mm_s: Vec3

    def advance(self, force_n: Vec3, elapsed_s: float) -> None:
        """Let a constant force act for a time."""


class DrivenHand:
    """A hand that nothing holds back: its motion is a given function of time, per axis."""

    def __init__(self, path: Callable[[float], Vec3]) -> None:
        self._path, self._time_s = path, 0.0
        self.position_mm, self.velocity_mm_s = path(0.0), ZERO

    def advance(self, force_n: Vec3, elapsed_s: float) -> None:
        """Move on."""
        self._time_s += elapsed_s
        before, self.position_mm = self.position_mm, self._path(self._time_s)
        x, y, z = ((now - then) / elapsed_s for now, then in zip(self.position_mm, before, strict=True))
        self.velocity_mm_s = x, y, z


class WilfulHand(SimulatedHand):
    """An arm, or a thrown device, that wants to be somewhere else all the time."""

    def __init__(self, rng: random.Random, impedance: ArmImpedance, *, thrown: bool) -> None:
        super().__init__((rng.uniform(-2, 2), rng.uniform(-1, 3), 0.0), impedance)
        self._rng, self._left_s = rng, 0.0
        if thrown:
            self.velocity_mm_s = (rng.uniform(-50, 50), -rng.uniform(20, 200), 0.0)

    def advance(self, force_n: Vec3, elapsed_s: float) -> None:
        """Want something new now and then, and yield."""
        self._left_s -= elapsed_s
        if self._left_s <= 0:
            self._left_s = self._rng.uniform(0.03, 0.4)
            self.intended_mm = (self._rng.uniform(-6, 6), self._rng.uniform(-8, 6), self._rng.uniform(-3, 3))
        super().advance(force_n, elapsed_s)


class Outcome(Struct):
    """What a session gave the hand, and whether it kept the limits."""

    motions: int = 0
    energy_mj: float = 0.0
    """The largest net energy since the clutch was engaged."""
    excess_n: float = 0.0
    """The largest force beyond the limits."""
    most_n: float = 0.0
    """The largest force; a suite in which nothing pushes shows nothing."""

    def add(self, other: "Outcome") -> None:
        """Keep the worst of both."""
        self.motions += other.motions
        self.energy_mj = max(self.energy_mj, other.energy_mj)
        self.excess_n = max(self.excess_n, other.excess_n)
        self.most_n = max(self.most_n, other.most_n)


def waves(rng: random.Random, delay_ms: float) -> Callable[[float], Vec3]:
    """Return a sum of sinusoids, often of the frequency that a delay excites most."""
    worst_hz = 1000.0 / (4 * (delay_ms + 1.5)) if rng.random() < 0.5 else 12.0
    hz = [min(rng.choice((rng.uniform(0.3, 12.0), worst_hz)), 40.0) for _ in range(3)]
    share = rng.choice(((0.1, 1.0, 0.1), (0.6, 0.7, 0.2), (1.0, 0.3, 0.0)))
    size = [
        min(SPEED_MM_S * s / math.hypot(*share) / (2 * math.pi * f), 8.0)
        for f, s in zip(hz, share, strict=True)
    ]
    phase = [rng.uniform(0, 2 * math.pi) for _ in range(3)]
    offset = rng.uniform(-2, 2)

    def path(time_s: float) -> Vec3:
        x, y, z = (
            a * math.sin(2 * math.pi * f * time_s + p) for a, f, p in zip(size, hz, phase, strict=True)
        )
        return x, y + offset, z

    return path


def strokes(rng: random.Random) -> Callable[[float], Vec3]:
    """Return slow ways into a wall and fast ways out, or the reverse: what gains most from a delay."""
    depth_mm, rest_s = rng.uniform(0.3, 6.0), rng.choice((0.0, rng.uniform(0.0, 0.1)))
    speeds = [rng.uniform(10, SPEED_MM_S), rng.uniform(0.5, 1.0) * SPEED_MM_S]
    rng.shuffle(speeds)
    into_s, out_s = (depth_mm / speed for speed in speeds)
    angle = rng.uniform(-0.5, 0.5)
    offset = rng.uniform(-0.5, 0.5)

    def path(time_s: float) -> Vec3:
        within_s = time_s % (into_s + rest_s + out_s)
        if within_s < into_s:
            y = -depth_mm * within_s / into_s
        else:
            y = -depth_mm * (1 - max(within_s - into_s - rest_s, 0.0) / out_s)
        return offset + y * math.sin(angle), offset + y * math.cos(angle), 0.0

    return path


def random_hand(rng: random.Random, delay_ms: float) -> Hand:
    """Return one of all kinds of hands."""
    kind = rng.randrange(5)
    if kind == 0:
        return DrivenHand(waves(rng, delay_ms))
    if kind == 1:
        return DrivenHand(strokes(rng))
    if kind == 2:
        return WilfulHand(rng, ArmImpedance(), thrown=False)
    if kind == 3:
        arm = ArmImpedance(rng.uniform(0.1, 1.5), rng.uniform(0.001, 0.02), rng.uniform(0.03, 0.5))
        return WilfulHand(rng, arm, thrown=True)
    return WilfulHand(rng, ArmImpedance(rng.uniform(0.1, 0.6), rng.choice((0.0, 0.002)), 0.0), thrown=True)


def random_fixtures(rng: random.Random) -> tuple[Fixture, ...]:
    """Return up to three fixtures about the origin."""

    def wall() -> dict[str, float]:
        return {
            "stiffness_n_per_mm": math.exp(rng.uniform(math.log(0.05), math.log(5.0))),
            "damping_n_s_per_mm": rng.choice((0.0, rng.uniform(0, 0.02))),
            "limit_n": rng.uniform(0.3, 4.0),
        }

    tilt, planar = rng.uniform(-0.4, 0.4), rng.random() < 0.5
    plane = Fixture(
        "plane",
        (0.0, rng.uniform(-1, 1), 0.0),
        (math.sin(tilt), math.cos(tilt), 0.0),
        is_planar=planar,
        **wall(),
    )
    cone = Fixture(
        "cone", (0.0, rng.uniform(5, 40), 0.0), (math.sin(tilt), -math.cos(tilt), 0.0), rng.uniform(0.5, 10),
        is_planar=planar, **wall(),
    )  # fmt: skip
    viscous = Fixture(
        "viscous", damping_n_s_per_mm=rng.uniform(0.001, 0.1), limit_n=rng.uniform(0.2, 2.0), is_planar=planar
    )
    return tuple(rng.sample((plane, cone, viscous), rng.choice((1, 1, 2, 3))))


def jumped(rng: random.Random, fixtures: tuple[Fixture, ...], size_mm: float) -> tuple[Fixture, ...]:
    """Return fixtures as the next image places them."""
    x, y = rng.gauss(0, size_mm), rng.gauss(0, size_mm)
    return tuple(
        replace(one, point_mm=(one.point_mm[0] + x, one.point_mm[1] + y, one.point_mm[2])) for one in fixtures
    )


def session(seed: int, delay_ms: int, make: MakeRenderer = ForceRenderer) -> Outcome:
    """Let random hands move through random fixtures, one after the other, with one renderer.

    The loop's delay is split at random between the readings, which tell their age, and the force, whose delay
    varies in half of the sessions.
    """
    rng = random.Random(f"{seed} {delay_ms}")
    capabilities = replace(SimulatedForce.capabilities, delay_ms=float(delay_ms))
    renderer, outcome = make(capabilities), Outcome(MOTIONS_PER_SESSION)
    varies, jitters = rng.random() < 0.5, rng.random() < 0.25
    cycles = delay_ms // 2 if jitters else delay_ms
    late = rng.choice((0, cycles, rng.randint(0, cycles)))
    early = cycles - late
    noise_mm, jump_mm = rng.choice((0.0, 0.002, 0.01)), rng.choice((0.0, 0.02, 0.1, 1.0))
    readings: deque[HandReading] = deque(maxlen=late + 1)
    forces: deque[Vec3] = deque([ZERO] * (early + 1), maxlen=early + 1)
    now_ns, acting, energy_mj = 10**9, ZERO, 0.0
    origin_mm, most_limit_n = ZERO, 0.0
    for motion in range(MOTIONS_PER_SESSION):
        hand, fixtures = random_hand(rng, delay_ms), random_fixtures(rng)
        shift = [there - here for there, here in zip(origin_mm, hand.position_mm, strict=True)]
        limit_n = max(one.limit_n for one in fixtures)
        most_limit_n = max(limit_n, most_limit_n)
        back = 0
        for cycle in range(MOTION_MS + (START_MS if motion == 0 else 0)):
            if cycle % IMAGE_MS == 0:
                fixtures = jumped(rng, fixtures, jump_mm if cycle else 0.0)
                placed = tuple(_shifted(one, shift) for one in fixtures)
                renderer.take(placed, now_ns, now_ns)
            if cycle == IMAGE_MS:
                most_limit_n = limit_n  # those of the motion before have faded
            x, y, z = (
                at + off + rng.gauss(0, noise_mm) for at, off in zip(hand.position_mm, shift, strict=True)
            )
            readings.append(HandReading(now_ns, (x, y, z), hand.velocity_mm_s, True))
            elapsed_ns = round(PERIOD_NS * rng.uniform(0.6, 2.0)) if jitters else PERIOD_NS
            now_ns += elapsed_ns
            force_n = renderer.step(readings[0], now_ns)
            size_n = math.hypot(*force_n)
            outcome.most_n = max(outcome.most_n, size_n)
            outcome.excess_n = max(
                outcome.excess_n, size_n - min(most_limit_n, capabilities.max_force_n) * (1 + 1e-9)
            )
            forces.append(force_n)
            before = hand.position_mm
            hand.advance(acting, elapsed_ns / 1e9)
            energy_mj += sum(
                f * (at - then) for f, at, then in zip(acting, hand.position_mm, before, strict=True)
            )
            outcome.energy_mj = max(outcome.energy_mj, energy_mj)
            back = min(max(back + rng.choice((-1, 0, 1)), 0), early) if varies else 0
            acting = forces[back]
        origin_mm = tuple(at + off for at, off in zip(hand.position_mm, shift, strict=True))
    return outcome


def _shifted(fixture: Fixture, shift: list[float]) -> Fixture:
    x, y, z = (at + off for at, off in zip(fixture.point_mm, shift, strict=True))
    return replace(fixture, point_mm=(x, y, z))
