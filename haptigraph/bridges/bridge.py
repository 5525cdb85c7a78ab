"""The sink behind every bridge: a short queue and a thread, so that no network can delay the loop.

Items that do not fit the queue are dropped, the oldest first, and counted. A failing link is reported once
and retried with the next step. The queue has no lock that Ctrl-C could leave held by the loop, because the
thread that silences the actuator writes to it, too.
"""

import threading
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from queue import Empty, SimpleQueue
from typing import Any, Protocol

from msgspec import Struct

from haptigraph.clock import Clock
from haptigraph.messages import Capture, Fault, Step
from haptigraph.projection import ImageGeometry
from haptigraph.recording.schema import RunInfo

__all__ = ["Bridge", "Link", "RunContext"]

MAX_QUEUED = 16  # half a second at 30 images/s
MAX_PROBLEMS = 20
CLOSE_TIMEOUT_S = 2.0


class RunContext(Struct, frozen=True):
    """The run that a bridge publishes."""

    info: RunInfo
    image: ImageGeometry
    """Transformation between images and eye frame."""
    measures: tuple[str, ...]
    """Names of the measures in the graphs."""
    clock: Clock
    teleop: Any
    """The source's `teleop`, if others may steer it."""


class Link(Protocol):
    """The connection to one kind of network. One thread calls everything except `take_problems`."""

    def send_step(self, capture: Capture, step: Step) -> None:
        """Send one step; may raise any exception."""
        ...

    def send_output(self, stamp_ns: int, amplitude: float, frequency_hz: float) -> None:
        """Send one change of the device's output, as limited by the guard."""
        ...

    def take_problems(self) -> tuple[str, ...]:
        """Return the network's problems since the last call, a sentence each."""
        ...

    def close(self) -> None:
        """Disconnect. May be called twice."""
        ...


class Bridge:
    """Send every step and every change of the haptic output to a link.

    Args:
        name: Of the bridge, for faults.
        link: The connection.
    """

    def __init__(self, name: str, link: Link) -> None:
        self.dropped = 0
        self._name, self._link = name, link
        self._items: SimpleQueue[Callable[[Link], None] | None] = SimpleQueue()
        self._faults: deque[Fault] = deque()
        self._reported: set[str] = set()
        self._closing = False
        self._thread = threading.Thread(target=self._run, name=f"haptigraph-{name}", daemon=True)
        self._thread.start()

    def write(self, capture: Capture, step: Step) -> None:
        """Queue one step."""
        self._put(lambda link: link.send_step(capture, step))

    def send_output(self, stamp_ns: int, amplitude: float, frequency_hz: float) -> None:
        """Queue one change of the haptic output."""
        self._put(lambda link: link.send_output(stamp_ns, amplitude, frequency_hz))

    def take_faults(self) -> tuple[Fault, ...]:
        """Return the faults since the last call; each problem is reported once."""
        for problem in self._link.take_problems():
            self._report(problem)
        return tuple(self._faults.popleft() for _ in range(len(self._faults)))

    def close(self) -> None:
        """Send the queue and disconnect, in bounded time. May be called twice."""
        if self._closing:
            return
        self._closing = True
        self._items.put(None)
        self._thread.join(CLOSE_TIMEOUT_S)
        if self._thread.is_alive():
            self._report("does not respond; it was abandoned")

    def _put(self, item: Callable[[Link], None]) -> None:
        if self._items.qsize() >= MAX_QUEUED and not self._closing:
            with suppress(Empty):
                self._items.get_nowait()
                self.dropped += 1
        self._items.put(item)

    def _run(self) -> None:
        try:
            while (item := self._items.get()) is not None:
                try:
                    item(self._link)
                except Exception as error:  # a network may fail in any way; the thread must survive
                    self.dropped += 1
                    self._report(str(error) or type(error).__name__)
        finally:
            self._link.close()

    def _report(self, problem: str) -> None:
        """Queue a fault for the loop, once each, up to a maximum number of different ones."""
        if problem not in self._reported and len(self._reported) < MAX_PROBLEMS:
            self._reported.add(problem)
            self._faults.append(Fault("bridge", f"{self._name}: {problem}"))
