"""The loop that moves a robot, in a process of its own: readings and a hand's motion -> commands, at 200 Hz.

Run as a program, this module is that process. It holds the robot and ends when its standard input ends: when
the program that started it closes it or dies. No read and no write of its pipes ever blocks.
"""

import gc
import os
import sys
from collections.abc import Sequence
from contextlib import suppress
from typing import Protocol

from haptigraph.child_process import obey_sigterm_only, raise_priority
from haptigraph.clock import Clock, Cycles, MonotonicClock
from haptigraph.errors import BadInput, HaptigraphError
from haptigraph.pipes import PipeReader, PipeWriter
from haptigraph.robot.check_report import checked
from haptigraph.robot.controller import RATE_HZ, Action, Controller, Hold, Move
from haptigraph.robot.interface import Robot, RobotReading
from haptigraph.robot.messages import Input, Report
from haptigraph.robot.opening import open_robot
from haptigraph.robot.setup import load_setup

__all__ = [
    "PERIOD_NS",
    "Inputs",
    "Reports",
    "RobotLoop",
    "main",
]

PERIOD_NS = round(1e9 / RATE_HZ)
REPORT_CYCLES = 4
OVERDUE_NS = 20_000_000
"""A command that takes so long to compute is out of date, and not sent."""


class Inputs(Protocol):
    """Where the messages to the loop come from."""

    def take(self) -> Sequence[Input] | None:
        """Return the messages since the last call; None at their end. Does not block."""
        ...


class Reports(Protocol):
    """Where the reports of the loop go."""

    def send(self, report: Report) -> None:
        """Send a report, or drop it. Does not block."""
        ...


class RobotLoop:
    """The loop of one robot.

    Args:
        robot: The robot; closed with the loop.
        controller: Decides on each cycle.
        clock: Real or virtual time.
        inputs: Messages from the program.
        reports: Reports to it.
    """

    def __init__(
        self, robot: Robot, controller: Controller, clock: Clock, inputs: Inputs, reports: Reports
    ) -> None:
        self._robot, self._controller, self._clock = robot, controller, clock
        self._inputs, self._reports = inputs, reports
        self._cycles = Cycles(clock, PERIOD_NS)
        self._is_switched_on = self._was_moving = False
        self._fault = self._error = ""
        self._done = 0
        self._reading: RobotReading | None = None
        self._readings: list[RobotReading] = []
        self._late_ns: list[int] = []

    def run(self) -> None:
        """Run until the inputs end; then the robot is held and closed."""
        try:
            while self.cycle():
                pass
        finally:
            self._robot.close()

    def cycle(self) -> bool:
        """Wait for the next cycle and do it; return whether there is another."""
        now_ns, late_ns = self._cycles.wait()
        inputs = self._inputs.take()
        if inputs is None:
            return False
        self._late_ns.append(late_ns)
        action = self._act(now_ns, inputs)
        self._report(now_ns, action)
        return True

    def _act(self, now_ns: int, inputs: Sequence[Input]) -> Action:
        """Do everything that may fail; a failure holds the robot and is a fault of the next cycle."""
        fault, self._fault = self._fault, ""
        try:
            is_switched_on = self._apply(inputs)
            reading = self._robot.read()
            if reading.number != (self._reading.number if self._reading else 0):
                self._readings.append(reading)
            self._reading = reading
            hands = [each.hand for each in inputs if each.hand is not None]
            action = self._controller.step(now_ns, reading, hands, is_switched_on=is_switched_on, fault=fault)
            if self._clock.now_ns() - now_ns > OVERDUE_NS:
                self._fault, action = "a cycle took too long", Hold(("a cycle took too long",))
            if isinstance(action, Move):
                self._robot.move(action.pose, now_ns)
            else:
                self._robot.hold(now_ns)
            return action
        except Exception as error:  # whatever fails, the robot is held
            self._fault = self._error = f"{type(error).__name__}: {error}"
            with suppress(Exception):
                self._robot.hold(now_ns)
            return Hold((self._fault,))

    def _apply(self, inputs: Sequence[Input]) -> bool:
        """Apply switch, settings and requests; return the switch, off if it was off in between."""
        was_off = False
        for each in inputs:
            self._is_switched_on = each.is_switched_on
            was_off |= not each.is_switched_on
            if each.settings is not None:
                self._controller.settings = each.settings
            if each.request is not None:
                self._robot.request(each.request)
        return self._is_switched_on and not was_off

    def _report(self, now_ns: int, action: Action) -> None:
        is_moving = isinstance(action, Move)
        self._done += 1
        if self._done % REPORT_CYCLES and is_moving == self._was_moving and self._done > 1:
            return
        self._was_moving = is_moving
        self._reports.send(
            Report(
                is_moving,
                () if isinstance(action, Move) else action.reasons,
                self._reading,
                self._readings,
                self._late_ns,
                self._cycles.missed,
                now_ns,
                self._controller.hand,
                self._error,
            )
        )
        self._readings, self._late_ns = [], []


def main() -> None:
    """Open the robot that the arguments specify and run its loop."""
    obey_sigterm_only(sys.exit)
    uri, setup_path = sys.argv[1:]
    inputs, reports = PipeReader(0, Input), PipeWriter(os.dup(1))
    os.dup2(2, 1)  # whatever a robot's library prints must not get between the reports
    clock = MonotonicClock()
    raise_priority()  # also of the threads that the robot's library starts: the loop waits for Python's lock
    try:
        controller = Controller(load_setup(setup_path), is_checked=_is_checked(uri, setup_path))
        robot = open_robot(uri, clock)
    except HaptigraphError as error:
        reports.send(Report(False, (), None, [], [], error=str(error)))
        sys.exit(1)
    gc.collect()
    gc.freeze()  # so that a collection is short
    RobotLoop(robot, controller, clock, inputs, reports).run()


def _is_checked(uri: str, setup_path: str) -> bool:
    try:
        checked(uri, setup_path)
    except BadInput:
        return False
    return True


if __name__ == "__main__":
    main()
