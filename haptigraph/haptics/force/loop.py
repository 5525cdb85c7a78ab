"""The loop that renders force, in a process of its own: fixtures and hand -> force, at 1 kHz.

Run as a program, this module is that process. It opens its device on command, and lets go of the hand when
its standard input ends (the run closes it or dies), when the run is silent, on SIGTERM, and when the device
fails. It exits with 0 only if the device confirmed that it let go.
"""

import gc
import os
import sys
from collections import deque
from collections.abc import Sequence
from typing import Protocol

from haptigraph.child_process import obey_sigterm_only, raise_priority
from haptigraph.clock import Clock, Cycles, MonotonicClock
from haptigraph.errors import HaptigraphError
from haptigraph.haptics.force.fixture import Fixture, to_hand
from haptigraph.haptics.force.interface import ForceDevice, HandReading
from haptigraph.haptics.force.messages import ForceInput, ForceReport
from haptigraph.haptics.force.renderer import ForceRenderer
from haptigraph.importing import load
from haptigraph.messages import ForceSample
from haptigraph.pipes import PipeReader, PipeWriter
from haptigraph.robot.pose import Vec3

__all__ = ["PERIOD_NS", "ForceLoop", "Inputs", "Rendering", "Reports", "main"]

PERIOD_NS = 1_000_000
REPORT_CYCLES = 10
LET_GO_CYCLES = 20
HISTORY = 2000  # readings of the hand that are kept to find where it was when an image was taken
ZERO: Vec3 = (0.0, 0.0, 0.0)


class Inputs(Protocol):
    """Where the fixtures come from."""

    def take(self) -> Sequence[ForceInput] | None:
        """Return the messages since the last call; None at their end. Does not block."""
        ...


class Reports(Protocol):
    """Where the reports of the loop go."""

    def send(self, message: ForceReport) -> None:
        """Send a report, or drop it. Does not block."""
        ...


class Rendering(Protocol):
    """What turns fixtures into force."""

    problem: str
    """The fault because of which force is released; empty: none."""

    def take(self, fixtures: Sequence[Fixture], stamp_ns: int, now_ns: int) -> None:
        """Take the fixtures of a step, in the frame of the hand."""
        ...

    def step(self, reading: HandReading, now_ns: int) -> Vec3:
        """Return the force of one cycle [N]."""
        ...

    def release(self, because: str, now_ns: int) -> None:
        """Let go."""
        ...


class ForceLoop:
    """The loop of one force device.

    Args:
        device: The device; closed with the loop.
        renderer: Decides on the force of each cycle.
        clock: Real or virtual time.
        inputs: Fixtures from the run.
        reports: Reports to it.
    """

    def __init__(
        self, device: ForceDevice, renderer: Rendering, clock: Clock, inputs: Inputs, reports: Reports
    ) -> None:
        self._device, self._renderer, self._clock = device, renderer, clock
        self._inputs, self._reports = inputs, reports
        self._cycles = Cycles(clock, PERIOD_NS)
        self._done = 0
        self._is_ending = False
        self._late_ns: list[int] = []
        self._problems: list[str] = []
        self._problem = ""
        self._places: deque[tuple[int, Vec3]] = deque(maxlen=HISTORY)
        self._engaged_ns: int | None = None
        self._force_n = ZERO
        self._reading = device.exchange(ZERO)

    def end(self) -> None:
        """Let go and end, in the next cycle. May be called in a signal handler."""
        self._is_ending = True

    def run(self) -> None:
        """Run until the inputs end or the device fails; then let go of the hand and close the device.

        Raises:
            DeviceError: If the device did not confirm that it let go.
        """
        try:
            while self.cycle():
                pass
            self._let_go()
        except Exception as error:  # whatever fails, the device is closed
            self._report(self._clock.now_ns(), f"{error}" or type(error).__name__)
        finally:
            self._device.close()

    def cycle(self) -> bool:
        """Wait for the next cycle and do it; return whether there is another."""
        now_ns = self._await_cycle()
        inputs = self._inputs.take()
        if inputs is None or self._is_ending:
            return False
        if inputs:
            self._place(inputs[-1], now_ns)
        self._exchange(now_ns)
        self._done += 1
        if self._done % REPORT_CYCLES == 0:
            self._report(now_ns)
        return True

    def _await_cycle(self) -> int:
        now_ns, late_ns = self._cycles.wait()
        self._late_ns.append(late_ns)
        return now_ns

    def _place(self, given: ForceInput, now_ns: int) -> None:
        """Place the fixtures of a step about the hand, unless the clutch was released since its image."""
        if not given.fixtures:
            self._renderer.take((), given.stamp_ns, now_ns)
            return
        hand_mm = self._hand_mm(given.stamp_ns)
        if hand_mm is None or given.scale <= 0:
            return
        placed = tuple(to_hand(each, given.tip_mm, hand_mm, given.scale) for each in given.fixtures)
        self._renderer.take(placed, given.stamp_ns, now_ns)

    def _hand_mm(self, stamp_ns: int) -> Vec3 | None:
        """Return where the hand was; None if the clutch has not been engaged ever since."""
        if self._engaged_ns is None or stamp_ns < self._engaged_ns:
            return None
        for at_ns, place_mm in reversed(self._places):
            if at_ns <= stamp_ns:
                return place_mm
        return None

    def _exchange(self, now_ns: int) -> None:
        self._force_n = self._renderer.step(self._reading, now_ns)
        self._note(self._renderer.problem)
        self._reading = reading = self._device.exchange(self._force_n)
        if not reading.engaged:
            self._engaged_ns = None
        elif self._engaged_ns is None:
            self._engaged_ns = reading.stamp_ns
        self._places.append((reading.stamp_ns, reading.position_mm))

    def _note(self, problem: str) -> None:
        """Keep a problem for the next report, once."""
        if problem and problem != self._problem:
            self._problems.append(problem)
        self._problem = problem

    def _report(self, now_ns: int, error: str = "") -> None:
        reading = self._reading
        sample = ForceSample(reading.stamp_ns, reading.position_mm, self._force_n, reading.engaged)
        report = ForceReport(
            [sample], self._late_ns, self._cycles.missed, now_ns, tuple(self._problems), error=error
        )
        self._late_ns, self._problems = [], []
        self._reports.send(report)

    def _let_go(self) -> None:
        """Lower the force to zero within `LET_GO_CYCLES`."""
        for _ in range(LET_GO_CYCLES):
            now_ns = self._await_cycle()
            self._renderer.release("the run has ended", now_ns)
            self._exchange(now_ns)
            if self._force_n == ZERO:
                return
        self._device.exchange(ZERO)


def main() -> None:
    """Wait for a byte on standard input, open the device that the arguments name, and run its loop."""
    obey_sigterm_only(sys.exit)
    path, argument, deadman_ms = sys.argv[1:]
    reports = PipeWriter(os.dup(1))
    os.dup2(2, 1)  # whatever a device's library prints must not get between the reports
    opens = load(path)
    if not os.read(0, 1):
        sys.exit(0)  # a process in reserve that was not needed
    clock = MonotonicClock()
    raise_priority()  # also of the threads that the device's library starts
    try:
        device: ForceDevice = opens(argument, clock)
    except HaptigraphError as error:
        reports.send(ForceReport([], [], error=str(error)))
        sys.exit(1)
    gc.collect()
    gc.freeze()  # so that a collection is short
    try:
        renderer = ForceRenderer(device.capabilities, deadman_ms=float(deadman_ms))
        loop = ForceLoop(device, renderer, clock, PipeReader(0, ForceInput), reports)
        obey_sigterm_only(loop.end)
        reports.send(ForceReport([], [], stamp_ns=clock.now_ns(), capabilities=device.capabilities))
        loop.run()
    except (HaptigraphError, OSError) as error:
        reports.send(ForceReport([], [], error=str(error)))
        sys.exit(1)
    finally:
        device.close()


if __name__ == "__main__":
    main()
