"""Drive a guard in real time, in a thread of its own: edges on time, and silence even if the loop stalls."""

import threading

from haptigraph.clock import Clock
from haptigraph.haptics.guard import Guard
from haptigraph.messages import Fault, Step

__all__ = ["Player"]

LONGEST_WAIT_S = 0.05
STILL_TIMEOUT_S = 1.0
CLOSE_TIMEOUT_S = 10.0  # a device may have a file to finish


class Player:
    """Own a guard and play it by the clock.

    Only this thread touches guard and device, so a device that blocks cannot hold up the loop.

    Args:
        guard: The guard to drive.
        clock: The run's clock.
    """

    def __init__(self, guard: Guard, clock: Clock) -> None:
        self._guard, self._clock = guard, clock
        self._changed = threading.Condition()
        self._newest: Step | None = None
        self._closing = False
        self._faults: list[Fault] = []
        self._stilled = threading.Event()
        self._thread = threading.Thread(target=self._play, name="haptigraph-player", daemon=True)
        self._thread.start()

    def send(self, step: Step, now_ns: int) -> None:
        """Hand over the newest step; returns at once."""
        with self._changed:
            self._newest = step
            self._changed.notify()

    def take_faults(self) -> tuple[Fault, ...]:
        """Return what went wrong since last asked."""
        with self._changed:
            faults, self._faults = tuple(self._faults), []
        return faults

    def close(self) -> None:
        """Still the hand, release the device, end the thread."""
        with self._changed:
            self._closing = True
            self._changed.notify()
        if self._stilled.wait(STILL_TIMEOUT_S):
            self._thread.join(CLOSE_TIMEOUT_S)
        else:
            with self._changed:
                self._faults.append(Fault("device", "does not answer; it may still vibrate"))

    def _play(self) -> None:
        try:
            while not self._closing:
                try:
                    self._turn()
                except BaseException as error:  # without this thread nobody would still the hand
                    self._recover(error)
        finally:
            self._guard.still()
            self._stilled.set()
            self._guard.close()
            self._collect()

    def _turn(self) -> None:
        """Wait for a step or an edge, whichever comes first, and let the hand feel it."""
        with self._changed:
            if self._newest is None and not self._closing:
                self._changed.wait(self._wait_s())
            step, self._newest = self._newest, None
        now_ns = self._clock.now_ns()
        if step is not None:
            self._guard.send(step, now_ns)
        else:
            self._guard.advance(now_ns)
        self._collect()

    def _recover(self, error: BaseException) -> None:
        """Still the hand after a failure of the guard, and say so; the next step is felt again."""
        self._guard.still()
        with self._changed:
            self._faults.append(Fault("guard", f"{type(error).__name__}: {error}; the hand was stilled"))
            if self._newest is None and not self._closing:
                self._changed.wait(LONGEST_WAIT_S)  # so that a failure that stays is not told too often

    def _wait_s(self) -> float:
        edge_ns = self._guard.next_edge_ns()
        if edge_ns is None:
            return LONGEST_WAIT_S
        return min(LONGEST_WAIT_S, max(0.0, (edge_ns - self._clock.now_ns()) / 1e9))

    def _collect(self) -> None:
        faults = self._guard.take_faults()
        if faults:
            with self._changed:
                self._faults.extend(faults)
