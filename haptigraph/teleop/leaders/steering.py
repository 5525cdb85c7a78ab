"""Move a robot by a leader: a thread that polls it, and releases the clutch when the leader is lost.

After a start, a loss and a reconnection nothing moves until the clutch is released and pressed again: a pad
whose button jams, or that somebody holds while plugging it in, moves nothing.
"""

import threading
from collections import deque
from collections.abc import Callable
from contextlib import suppress

from haptigraph.errors import DeviceError
from haptigraph.messages import Capture, Fault, Step
from haptigraph.teleop.leaders.leader import Leader
from haptigraph.teleop.motion import HandMotion

__all__ = ["Steering"]

PERIOD_S = 0.01
CLOSE_S = 2.0
MAX_FAULTS = 20
RELEASED = HandMotion(engaged=False)


class Steering:
    """Pass the motions of a leader on. A sink too: its losses become faults of the run.

    Args:
        name: Of the leader, for messages.
        leader: The leader; closed with this object.
        put: Receives the motions, for instance `Teleop.put`.
        report: Receives a sentence when the leader is lost, and when it is back.
    """

    dropped = 0

    def __init__(
        self,
        name: str,
        leader: Leader,
        put: Callable[[HandMotion], None],
        report: Callable[[str], None] = lambda problem: None,
    ) -> None:
        self._name, self._leader, self._put, self._report = name, leader, put, report
        self._is_armed = self._is_lost = False
        self._faults: deque[Fault] = deque(maxlen=MAX_FAULTS)
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._run, name="haptigraph-leader", daemon=True)

    def start(self) -> "Steering":
        """Poll the leader in a thread until `close`."""
        self._thread.start()
        return self

    def step(self) -> None:
        """Poll the leader once."""
        try:
            motions = self._leader.take()
        except DeviceError as error:
            self._lose(str(error))
            return
        except Exception as error:  # a fault of ours must not leave the clutch engaged
            self._lose(f"{type(error).__name__}: {error}")
            return
        if motions and self._is_lost:
            self._is_lost = False
            self._report(f"{self._name}: is back; release the clutch, then press it to move")
        for motion in motions:
            self._is_armed |= not motion.engaged
            self._put(motion if self._is_armed else RELEASED)

    def write(self, capture: Capture, step: Step) -> None:
        """Do nothing: a leader does not depend on images."""

    def take_faults(self) -> tuple[Fault, ...]:
        """Return the losses since the last call."""
        return tuple(self._faults.popleft() for _ in range(len(self._faults)))

    def close(self) -> None:
        """Release the clutch, and close the leader. May be called twice."""
        self._closing.set()
        if self._thread.is_alive():
            self._thread.join(CLOSE_S)
        try:
            self._put(RELEASED)
        finally:
            self._leader.close()

    def _lose(self, problem: str) -> None:
        self._is_armed = False
        self._put(RELEASED)
        if not self._is_lost:
            self._is_lost = True
            self._faults.append(Fault("leader", f"{self._name}: {problem}"))
            self._report(f"{self._name}: {problem}")

    def _run(self) -> None:
        while not self._closing.wait(PERIOD_S):
            with suppress(OSError):  # what is steered has ended
                self.step()
