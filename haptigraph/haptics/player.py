"""Drive a guard in real time, in a thread of its own: edges on time, and silence even if the loop stalls.

Between the loop and this thread lie only queues that the interpreter works in one step. Ctrl-C strikes the
loop anywhere, also between taking a lock and noting that it is held; then nobody could still the hand.
"""

import threading
from collections import deque
from contextlib import suppress
from queue import Empty, SimpleQueue

from haptigraph.clock import Clock
from haptigraph.haptics.guard import Guard
from haptigraph.messages import Fault, Step

__all__ = ["Player"]

LONGEST_WAIT_S = 0.05
SILENCE_TIMEOUT_S = 1.0
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
        self._steps: SimpleQueue[Step | None] = SimpleQueue()
        self._closing = self._has_failed = False
        self._faults: deque[Fault] = deque()
        self._stilled: SimpleQueue[None] = SimpleQueue()
        self._thread = threading.Thread(target=self._play, name="haptigraph-player", daemon=True)
        self._thread.start()

    def send(self, step: Step, now_ns: int) -> None:
        """Hand over the newest step; returns at once."""
        with suppress(Empty):  # it takes the place of one that still waits for a device that blocks
            self._steps.get_nowait()
        self._steps.put(step)

    def take_faults(self) -> tuple[Fault, ...]:
        """Return what went wrong since last asked."""
        return tuple(self._faults.popleft() for _ in range(len(self._faults)))

    def close(self) -> None:
        """Still the hand, release the device, end the thread."""
        self._closing = True
        self._steps.put(None)
        try:
            self._stilled.get(timeout=SILENCE_TIMEOUT_S)
        except Empty:
            self._faults.append(Fault("device", "does not answer; it may still vibrate"))
        else:
            self._stilled.put(None)  # it may be asked again
            self._thread.join(CLOSE_TIMEOUT_S)

    def _play(self) -> None:
        try:
            while not self._closing:
                try:
                    self._turn()
                except BaseException as error:  # without this thread nobody would still the hand
                    self._recover(error)
        finally:
            self._guard.silence()
            self._stilled.put(None)
            self._guard.close()
            self._faults.extend(self._guard.take_faults())

    def _turn(self) -> None:
        """Wait for a step or an edge, whichever comes first, and let the hand feel it."""
        step = None
        with suppress(Empty):
            step = self._steps.get(timeout=self._wait_s())
        now_ns = self._clock.now_ns()
        if step is not None:
            self._guard.send(step, now_ns)
        else:
            self._guard.advance(now_ns)
        self._faults.extend(self._guard.take_faults())

    def _recover(self, error: BaseException) -> None:
        """Still the hand after a failure of the guard, and say so; the next step is felt again."""
        self._has_failed = True
        self._guard.silence()
        self._faults.append(Fault("guard", f"{type(error).__name__}: {error}; the hand was stilled"))

    def _wait_s(self) -> float:
        if self._has_failed:  # a failure that stays is not told too often
            self._has_failed = False
            return LONGEST_WAIT_S
        edge_ns = self._guard.next_edge_ns()
        if edge_ns is None:
            return LONGEST_WAIT_S
        return min(LONGEST_WAIT_S, max(0.0, (edge_ns - self._clock.now_ns()) / 1e9))
