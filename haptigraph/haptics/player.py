"""Drive a guard in real time from a thread of its own: edges on time, and silence even if the loop stalls.

Only queues with atomic operations connect the loop and this thread. Ctrl-C can interrupt the loop anywhere,
even between acquiring a lock and recording that it is held; after that nobody could silence the actuator.
"""

import threading
from collections import deque
from contextlib import suppress
from queue import Empty, SimpleQueue

from haptigraph.clock import Clock
from haptigraph.haptics.guard import Guard
from haptigraph.messages import Fault, Step

__all__ = ["Player"]

MAX_WAIT_S = 0.05
SILENCE_TIMEOUT_S = 2.0
CLOSE_TIMEOUT_S = 30.0  # a device may have a file to finish, or a board to restart


class Player:
    """Own a guard and drive it by the clock.

    Only this thread calls guard and device, so a device that blocks cannot delay the loop.

    Args:
        guard: The guard to drive.
        clock: The clock of the run.
    """

    def __init__(self, guard: Guard, clock: Clock) -> None:
        self._guard, self._clock = guard, clock
        self._steps: SimpleQueue[Step | None] = SimpleQueue()
        self._closing = self._has_failed = False
        self._faults: deque[Fault] = deque()
        self._silenced: SimpleQueue[None] = SimpleQueue()
        self._thread = threading.Thread(target=self._play, name="haptigraph-player", daemon=True)
        self._thread.start()

    def send(self, step: Step, now_ns: int) -> None:
        """Hand over the newest step; return at once."""
        with suppress(Empty):  # replace a step that still waits for a device that blocks
            self._steps.get_nowait()
        self._steps.put(step)

    def take_faults(self) -> tuple[Fault, ...]:
        """Return the faults since the previous call."""
        return tuple(self._faults.popleft() for _ in range(len(self._faults)))

    @property
    def is_silent(self) -> bool:
        """Whether the device was closed and raised no doubt that it is silent."""
        return self._guard.is_silent

    def close(self) -> None:
        """Silence the actuator, release the device, end the thread."""
        self._closing = True
        self._steps.put(None)
        try:
            self._silenced.get(timeout=SILENCE_TIMEOUT_S)
        except Empty:
            self._faults.append(Fault("device", "does not respond; it may still vibrate"))
        else:
            self._silenced.put(None)  # for a second call
            self._thread.join(CLOSE_TIMEOUT_S)

    def _play(self) -> None:
        try:
            while not self._closing:
                try:
                    self._turn()
                except BaseException as error:  # without this thread nobody could silence the actuator
                    self._recover(error)
        finally:
            self._guard.silence()
            self._silenced.put(None)
            self._guard.close()
            self._faults.extend(self._guard.take_faults())

    def _turn(self) -> None:
        """Wait for a step or an edge, whichever comes first, and pass it to the guard."""
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
        """Silence the actuator after a failure of the guard and report it; the next step is played again."""
        self._has_failed = True
        self._guard.silence()
        self._faults.append(Fault("guard", f"{type(error).__name__}: {error}; output silenced"))

    def _wait_s(self) -> float:
        if self._has_failed:  # limits how often a persistent failure is reported
            self._has_failed = False
            return MAX_WAIT_S
        edge_ns = self._guard.next_edge_ns()
        if edge_ns is None:
            return MAX_WAIT_S
        return min(MAX_WAIT_S, max(0.0, (edge_ns - self._clock.now_ns()) / 1e9))
