"""The sink behind every bridge: a short queue and a thread, so that no network can hold up the loop.

What does not fit the queue is dropped, the oldest first, and counted. A link that fails is told once, and
tried again with the next step. The queue has no lock that Ctrl-C could leave held by the loop: the thread
that stills the hand writes to it too.
"""

import threading
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from queue import Empty, SimpleQueue
from typing import Protocol

from msgspec import Struct

from haptigraph.clock import Clock
from haptigraph.geometry import ImageGeometry
from haptigraph.messages import Capture, Fault, Step
from haptigraph.recording.schema import RunInfo
from haptigraph.stages import Source

__all__ = ["Bridge", "Link", "Run"]

MOST_ITEMS = 16  # half a second at 30 images/s
MOST_TOLD = 20
CLOSE_TIMEOUT_S = 2.0


class Run(Struct, frozen=True):
    """What a bridge is told about the run it reports on."""

    info: RunInfo
    image: ImageGeometry
    """Where the eye frame lies in the images."""
    measures: tuple[str, ...]
    """Names of the measures that the graphs carry."""
    clock: Clock
    source: Source
    """For what others may steer."""


class Link(Protocol):
    """One kind of network. But for `take_problems`, called by one thread only."""

    def send(self, capture: Capture, step: Step) -> None:
        """Tell one step; may fail with any exception."""
        ...

    def felt(self, stamp_ns: int, amplitude: float, frequency_hz: float) -> None:
        """Tell one change of what the device was told, after the guard."""
        ...

    def take_problems(self) -> tuple[str, ...]:
        """Return what went wrong on the network since last asked, a sentence each."""
        ...

    def close(self) -> None:
        """Leave the network. May be called twice."""
        ...


class Bridge:
    """Tell a link every step and every change of touch.

    Args:
        name: Of the bridge, for faults.
        link: Where it leads.
    """

    def __init__(self, name: str, link: Link) -> None:
        self.dropped = 0
        self._name, self._link = name, link
        self._items: SimpleQueue[Callable[[Link], None] | None] = SimpleQueue()
        self._faults: deque[Fault] = deque()
        self._told: set[str] = set()
        self._closing = False
        self._thread = threading.Thread(target=self._run, name=f"haptigraph-{name}", daemon=True)
        self._thread.start()

    def write(self, capture: Capture, step: Step) -> None:
        """Queue one step."""
        self._put(lambda link: link.send(capture, step))

    def felt(self, stamp_ns: int, amplitude: float, frequency_hz: float) -> None:
        """Queue one change of touch."""
        self._put(lambda link: link.felt(stamp_ns, amplitude, frequency_hz))

    def take_faults(self) -> tuple[Fault, ...]:
        """Return what went wrong since last asked; each problem is told once."""
        for problem in self._link.take_problems():
            self._tell(problem)
        return tuple(self._faults.popleft() for _ in range(len(self._faults)))

    def close(self) -> None:
        """Send what is queued and leave the network, in bounded time. May be called twice."""
        if self._closing:
            return
        self._closing = True
        self._items.put(None)
        self._thread.join(CLOSE_TIMEOUT_S)
        if self._thread.is_alive():
            self._tell("does not answer; it was left behind")

    def _put(self, item: Callable[[Link], None]) -> None:
        if self._items.qsize() >= MOST_ITEMS and not self._closing:
            with suppress(Empty):
                self._items.get_nowait()
                self.dropped += 1
        self._items.put(item)

    def _run(self) -> None:
        try:
            while (item := self._items.get()) is not None:
                try:
                    item(self._link)
                except (
                    Exception
                ) as error:  # a network may fail in any way, and this thread serves it to the end
                    self.dropped += 1
                    self._tell(str(error) or type(error).__name__)
        finally:
            self._link.close()

    def _tell(self, problem: str) -> None:
        """Keep a fault for the loop, once each, and not without end if all differ."""
        if problem not in self._told and len(self._told) < MOST_TOLD:
            self._told.add(problem)
            self._faults.append(Fault("bridge", f"{self._name}: {problem}"))
