"""Approaches of a simulated arm with joint errors and latency: the shaft's distance from the RCM, and holds.

On a virtual clock: the same seeds give the same figures.

    python benchmarks/robot_approaches.py [--approaches 200] [--trials 500] [--seed 10000]
"""

import argparse
import math
import random
import sys
from collections.abc import Callable, Sequence
from itertools import pairwise

import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from haptigraph.clock import VirtualClock
from haptigraph.errors import DeviceError
from haptigraph.robot.controller import Controller
from haptigraph.robot.interface import Operating, RobotReading, StateCommand
from haptigraph.robot.loop import PERIOD_NS, RobotLoop
from haptigraph.robot.messages import Input, Report
from haptigraph.robot.pose import ToolPose
from haptigraph.robot.rcm import Rcm
from haptigraph.robot.setup import RobotSetup
from haptigraph.robot.simulated import EXAMPLE_SETUP, SimulatedRobot
from haptigraph.sim.robot.operator import Tremor
from haptigraph.teleop.motion import HandMotion, TeleopSettings

MS = 1_000_000
SCALE = 0.2
LIMIT_MS, TOLERANCE_MM = 50.0, 0.1
READY_MS = 700  # the robot is enabled and homed
START_MS = 800  # the hand starts
MOVING_MM = 1e-6
STILL = 1e-4  # mm, and degrees: of a joint in one cycle
SETUP = replace(EXAMPLE_SETUP, limits=replace(EXAMPLE_SETUP.limits, force_n=1.0))


class Hand:
    """A hand that inserts the instrument and moves it about, with tremor; its messages come unevenly.

    Args:
        seed: Of its path, its tremor and the rate of its messages.
        duration_s: Of the insertion.
    """

    def __init__(self, seed: int, duration_s: float = 6.0) -> None:
        self._rng = random.Random(f"hand {seed}")
        self._depth_mm = self._rng.uniform(28, 33) / SCALE
        self._sides = [(self._rng.uniform(-9, 9) / SCALE, self._rng.uniform(0.3, 0.8)) for _ in range(4)]
        self._tremor = [Tremor(0.1, 8.0, 12.0, seed + 7919 * axis) for axis in (0, 1)]
        self._duration_s = duration_s
        self._period_ms = 1e3 / self._rng.uniform(30, 250)
        self._released_s = self._rng.uniform(0.4, 0.8) * duration_s
        self._next_ns, self._before = START_MS * MS, self._at(0.0)

    def messages(self, now_ns: int) -> list[HandMotion]:
        """Return the messages until now."""
        sent = []
        while self._next_ns <= now_ns:
            time_s = (self._next_ns - START_MS * MS) / 1e9
            at = self._at(time_s)
            along, across, outwards = (at - self._before).tolist()
            self._before = at
            is_engaged = not 0 <= time_s - self._released_s < 0.3
            sent.append(HandMotion(is_engaged, along, across, 0.0, outwards))
            self._next_ns += round(self._period_ms * self._rng.uniform(0.7, 1.15) * MS)
        return sent

    def _at(self, time_s: float) -> np.ndarray:
        """Return where the hand is: along, across, outwards [mm]."""
        along = self._depth_mm * _minimum_jerk(time_s / self._duration_s)
        sides = [
            size * _minimum_jerk((time_s / self._duration_s - 0.15 * number) / length)
            for number, (size, length) in enumerate(self._sides)
        ]
        tremor = (*self._tremor[0].at(time_s), self._tremor[1].at(time_s)[0])
        return np.array((along, sides[0] + sides[2], sides[1] + sides[3])) + tremor


def _minimum_jerk(share: float) -> float:
    share = min(max(share, 0.0), 1.0)
    return share**3 * (10 - 15 * share + 6 * share**2)


class Fault(Struct):
    """What is wrong from a time on, for a time."""

    kind: str
    begin_ns: int
    end_ns: int

    def is_on(self, now_ns: int) -> bool:
        """Return whether it happens at a time."""
        return self.begin_ns <= now_ns < self.end_ns


class FaultyRobot:
    """A simulated robot whose measurements and connection fail; it keeps what it was commanded.

    Args:
        robot: The robot.
        clock: The run's.
        fault: What fails; None: nothing.
    """

    def __init__(self, robot: SimulatedRobot, clock: VirtualClock, fault: Fault | None) -> None:
        self._robot, self._clock, self._fault = robot, clock, fault
        self._last = RobotReading(0, 0)
        self.moves: list[tuple[int, ToolPose]] = []

    def read(self) -> RobotReading:
        """Return what it measures, or what the fault makes of it."""
        reading = replace(self._robot.read(), force_n=(0.0, 0.0, 0.1))
        kind = self._fault.kind if self._fault and self._fault.is_on(self._clock.now_ns()) else ""
        if kind == "read fails":
            raise DeviceError("the network is gone")
        if not kind or reading.pose is None:
            self._last = reading
        return READINGS[kind](reading, self._last) if kind in READINGS else reading

    def move(self, pose: ToolPose, stamp_ns: int) -> None:
        """Log a command and pass it on."""
        if self._fault and self._fault.kind == "move fails" and self._fault.is_on(stamp_ns):
            raise DeviceError("the network is gone")
        self.moves.append((stamp_ns, pose))
        self._robot.move(pose, stamp_ns)

    def hold(self, stamp_ns: int) -> None:
        """Pass it on."""
        self._robot.hold(stamp_ns)

    def request(self, command: StateCommand) -> None:
        """Pass it on."""
        self._robot.request(command)

    def close(self) -> None:
        """Pass it on."""
        self._robot.close()


def _moved_by(reading: RobotReading, step_mm: Sequence[float]) -> RobotReading:
    x, y, z = np.add(reading.pose.position_mm, step_mm).tolist()
    return replace(reading, pose=replace(reading.pose, position_mm=(x, y, z)))


READINGS: dict[str, Callable[[RobotReading, RobotReading], RobotReading]] = {
    "poses stop": lambda reading, last: last,
    "stamps freeze": lambda reading, last: replace(reading, stamp_ns=last.stamp_ns),
    "pose is nan": lambda reading, last: _moved_by(reading, (math.nan, 0, 0)),
    "pose is missing": lambda reading, last: replace(reading, pose=None),
    "pose jumps": lambda reading, last: _moved_by(reading, (0, 3, 0)),
    "paused": lambda reading, last: replace(reading, operating=Operating("PAUSED", True, False)),
    "disabled": lambda reading, last: replace(reading, operating=Operating("DISABLED", True, False)),
    "robot fault": lambda reading, last: replace(reading, operating=Operating("FAULT", True, False)),
    "not homed": lambda reading, last: replace(reading, operating=Operating("ENABLED", False, False)),
    "busy": lambda reading, last: replace(reading, operating=Operating("ENABLED", True, True)),
    "state unknown": lambda reading, last: replace(reading, operating=None),
    "force": lambda reading, last: replace(reading, force_n=(0.0, 2.0, 0.0)),
    "force unknown": lambda reading, last: replace(reading, force_n=None),
    "force is nan": lambda reading, last: replace(reading, force_n=(math.nan, 0.0, 0.0)),
}
FAULTS = (*READINGS, "read fails", "move fails", "leader lost", "loop late")


class Run:
    """A hand, the loop and the arm on a virtual clock.

    Args:
        seed: Of hand and arm.
        fault: What goes wrong.
        setup: Where RCM and eye are, and the limits.
        tremor_filter: Whether the hand's tremor is removed.
    """

    def __init__(
        self, seed: int, fault: Fault | None = None, setup: RobotSetup = SETUP, *, tremor_filter: bool = True
    ) -> None:
        self.clock = VirtualClock(0)
        self.arm = SimulatedRobot(str(seed), self.clock)
        self.robot = FaultyRobot(self.arm, self.clock, fault)
        self.rcm = Rcm(setup.rcm.at_mm, setup.shaft_axis_tool)
        self._fault, self._hand = fault, Hand(seed)
        settings = TeleopSettings(motion_scale=SCALE, tremor_filter=tremor_filter)
        controller = Controller(setup, settings, is_checked=True)
        self._inputs: list[Input] = [Input(False, request="enable"), Input(False, request="home")]
        self._loop = RobotLoop(self.robot, controller, self.clock, self, self)
        self.is_switched_on = False
        self.reports: list[tuple[int, Report]] = []

    def take(self) -> list[Input]:
        """Return the messages to the loop."""
        now_ns = self.clock.now_ns()
        hands = self._hand.messages(now_ns)
        if self._fault and self._fault.kind == "leader lost" and self._fault.is_on(now_ns):
            hands = []
        inputs = [*self._inputs, *(Input(self.is_switched_on, hand) for hand in hands)]
        self._inputs = []
        return [*inputs, Input(self.is_switched_on)]

    def send(self, report: Report) -> None:
        """Log a report of the loop."""
        self.reports.append((self.clock.now_ns(), report))

    def cycle(self) -> int:
        """Do one cycle; return its time."""
        fault, now_ns = self._fault, self.clock.now_ns()
        if fault and fault.kind == "loop late" and fault.begin_ns <= now_ns < fault.begin_ns + PERIOD_NS:
            self.clock.wait_until(fault.end_ns)
        self._loop.cycle()
        return self.clock.now_ns()

    def until(self, end_ms: float) -> None:
        """Do the cycles until a time."""
        while self.clock.now_ns() < end_ms * MS:
            self.cycle()

    def start(self) -> None:
        """Wait until the robot is ready, and switch on."""
        self.until(READY_MS)
        self.is_switched_on = True


def approach(seed: int) -> tuple[np.ndarray, float]:
    """Insert the instrument once.

    Returns:
        For each command: its shaft's distance from the RCM [mm], that of the true shaft at that time, and the
        true depth, (n, 3); and the depth at the end.
    """
    run = Run(seed, tremor_filter=seed % 2 == 0)
    run.start()
    rows = []
    while run.clock.now_ns() < (START_MS + 7000) * MS:
        count = len(run.robot.moves)
        run.cycle()
        if len(run.robot.moves) > count:
            command, true = run.robot.moves[-1][1], run.arm.true_pose()
            rows.append((run.rcm.distance_mm(command), run.rcm.distance_mm(true), run.rcm.depth_mm(true)))
    return np.array(rows), rows[-1][2]


class Held(Struct):
    """How soon a robot was held after a fault."""

    kind: str
    last_move_ms: float
    """From the fault to the last command that moved it; below 0: none came after it."""
    rest_ms: float
    """From the fault until the arm stood still; after a stall it is looked at only when that is over."""
    restarts: int
    """Commands to move after the fault was over, although nobody had switched off and on."""
    resumes: bool
    """Whether it moved again after that."""


def trial(seed: int) -> Held:
    """Let one fault happen at a random time of an approach."""
    rng = random.Random(f"trial {seed}")
    kind = FAULTS[seed % len(FAULTS)]
    begin_ns = round((START_MS + rng.uniform(200, 2200)) * MS)
    fault = Fault(kind, begin_ns, begin_ns + round(rng.uniform(110, 400) * MS))
    run = Run(seed, fault)
    run.start()
    rest_ns = begin_ns
    while run.clock.now_ns() < fault.end_ns + 300 * MS:
        before = run.arm.arm.joints
        now_ns = run.cycle()
        if np.abs(run.arm.arm.joints - before).max() > STILL:
            rest_ns = max(now_ns, begin_ns)
    moving = _moving(run.robot.moves)
    last_ns = max(stamp_ns for stamp_ns in moving if stamp_ns < fault.end_ns)
    restarts = sum(stamp_ns >= fault.end_ns for stamp_ns in moving)
    run.is_switched_on = False
    run.until(run.clock.now_ns() / MS + 150)
    count, run.is_switched_on = len(run.robot.moves), True
    run.until(run.clock.now_ns() / MS + 600)
    return Held(
        kind,
        (last_ns - begin_ns) / MS,
        (rest_ns - begin_ns) / MS,
        restarts,
        len(run.robot.moves) > count,
    )


def _moving(moves: list[tuple[int, ToolPose]]) -> list[int]:
    """Return when a command differed from the one before."""
    return [
        stamp_ns
        for (_, before), (stamp_ns, pose) in pairwise(moves)
        if math.dist(before.position_mm, pose.position_mm) > MOVING_MM
    ]


def main() -> None:
    """Print the figures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--approaches", type=int, default=200)
    parser.add_argument("--trials", type=int, default=500)
    parser.add_argument("--seed", type=int, default=10_000)
    options = parser.parse_args()
    report_approaches([approach(options.seed + number) for number in range(options.approaches)])
    held = [trial(options.seed + number) for number in range(options.trials)]
    report_trials(held)
    sys.exit(any(each.last_move_ms > LIMIT_MS for each in held))


def report_approaches(approaches: list[tuple[np.ndarray, float]]) -> None:
    """Print the distances from the RCM: the port constrains the shaft only while the tip is beyond it."""
    depths = [depth_mm for _, depth_mm in approaches]
    print(
        f"{len(depths)} approaches, {min(depths):.1f} to {max(depths):.1f} mm deep; distance to the RCM, mm:"
    )
    for where in ("inserted", "approaching the port"):
        parts = [rows[(rows[:, 2] >= 0) == (where == "inserted")] for rows, _ in approaches]
        rows = np.concatenate(parts)
        for name, column in (("commanded", 0), ("true", 1)):
            p95, most = np.percentile(rows[:, column], 95), rows[:, column].max()
            beyond = sum(part[:, column].max() > TOLERANCE_MM for part in parts)
            print(f"  {where:20} {name:9} p95 {p95:.2g}  max {most:.2g}  beyond {TOLERANCE_MM} in {beyond}")


def report_trials(held: list[Held]) -> None:
    """Print how soon the robot was held, fault by fault."""
    print(f"{'fault':16} {'n':>4} {'last move':>10} {'at rest':>8}  restarts  resumed   (worst, ms)")
    for kind in FAULTS:
        mine = [each for each in held if each.kind == kind]
        if mine:
            last_ms, rest_ms = max(e.last_move_ms for e in mine), max(e.rest_ms for e in mine)
            restarts, resumed = sum(e.restarts for e in mine), sum(e.resumes for e in mine)
            print(f"{kind:16} {len(mine):4} {last_ms:10.1f} {rest_ms:8.1f} {restarts:9} {resumed:8}")
    late = sum(each.last_move_ms > LIMIT_MS for each in held)
    print(f"{len(held)} trials; {late} commanded motion later than {LIMIT_MS:g} ms after the fault")


if __name__ == "__main__":
    main()
