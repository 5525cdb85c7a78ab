"""The place between the loop and its viewers: keeps the newest step, and hands it to whoever is ready.

The loop's thread leaves a step here in microseconds and goes on; all else happens in the server's thread.
A viewer that is slow misses images, and never holds up the loop or another viewer.
"""

import asyncio
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from typing import Any

from haptigraph.clock import Clock
from haptigraph.dashboard.server.protocol import packed, shown, told
from haptigraph.dashboard.server.viewer import Viewer
from haptigraph.messages import Capture, Fault, Step
from haptigraph.perception.eye_view import IoctView
from haptigraph.recording.codec import encode_jpeg

__all__ = ["Hub"]

JPEG_QUALITY = 80
MOST_EDGES = 1000
MOST_LATENCIES = 300
HEALTH_S = 0.5


class Hub:
    """A sink that viewers watch.

    Args:
        clock: The run's clock; viewers are told milliseconds since the hub was made.
    """

    def __init__(self, clock: Clock) -> None:
        self.dropped = 0  # a viewer that misses an image loses nothing that is kept
        self.viewers: list[Viewer] = []
        self.latencies_ns: deque[int] = deque(maxlen=MOST_LATENCIES)
        """From capture to command, of the last steps."""
        self.last_faults: dict[str, tuple[float, str]] = {}
        """The newest fault by where it was: when [ms], and what."""
        self.newest_capture: Capture | None = None
        """For pages that need what the source sees."""
        self._clock, self._origin_ns = clock, clock.now_ns()
        self._newest: tuple[Capture, Step] | None = None
        self._edges: deque[tuple[int, float, float]] = deque(maxlen=MOST_EDGES)
        self._server: asyncio.AbstractEventLoop | None = None
        self._fresh = asyncio.Event()
        self._number = 0
        self._view: IoctView | None = None
        self._moving: frozenset[str] = frozenset()
        self._lasting: dict[str, str] = {}

    # --- in the loop's thread, and the hand's ---------------------------------------------------------

    def write(self, capture: Capture, step: Step) -> None:
        """Leave the newest step."""
        if step.timing is not None:
            self.latencies_ns.append(step.timing.commanded_ns - step.stamp_ns)
        for fault in step.faults:
            self.last_faults[fault.where] = self.to_ms(step.stamp_ns), fault.message
        self.newest_capture = capture
        self._newest = capture, step
        self._wake()

    def felt(self, stamp_ns: int, amplitude: float, frequency_hz: float) -> None:
        """Leave what the device was told."""
        self._edges.append((stamp_ns, amplitude, frequency_hz))
        self._wake()

    def take_faults(self) -> tuple[Fault, ...]:
        """Return nothing: viewers that fail are not the loop's business."""
        return ()

    def close(self) -> None:
        """Do nothing: the server outlives the loop, so that the page can say how it ended."""

    def to_ms(self, stamp_ns: int) -> float:
        """Turn a stamp of the run's clock into what viewers are told."""
        return round((stamp_ns - self._origin_ns) / 1e6, 3)

    def now_ms(self) -> float:
        """Return the present, as viewers are told it."""
        return self.to_ms(self._clock.now_ns())

    def _wake(self) -> None:
        if self._server is not None and self.viewers:
            try:
                self._server.call_soon_threadsafe(self._fresh.set)
            except RuntimeError:  # the server has ended; nobody watches any more
                self._server = None

    # --- in the server's thread -----------------------------------------------------------------------

    def introduce(self, hello: str, view: IoctView, moving: frozenset[str]) -> None:
        """Set what the pages are about: before the server starts, or in its thread when another run begins.

        Args:
            hello: The first text that every viewer gets.
            view: Makes the picture of an image.
            moving: Names of the entities whose places are told with every image.
        """
        self._lasting.pop("ended", None)
        self._lasting = {**self._lasting, "hello": hello}
        self._view, self._moving, self._newest = view, moving, None
        for viewer in self.viewers:
            viewer.tell(hello)

    def join(self, viewer: Viewer) -> None:
        """Let a page watch; it is told first what the others know already."""
        for text in self._lasting.values():
            viewer.tell(text)
        self.viewers.append(viewer)

    def leave(self, viewer: Viewer) -> None:
        """Forget a page."""
        self.viewers.remove(viewer)

    def tell(self, kind: str, *, lasts: bool = False, **content: object) -> None:
        """Tell all viewers something; if it lasts, also those who come later (the newest of its kind)."""
        text = told(kind, **content)
        if lasts:
            self._lasting[kind] = text
        for viewer in self.viewers:
            viewer.tell(text)

    def tell_from_outside(self, kind: str, **content: object) -> None:
        """Tell all viewers something that lasts, from any thread."""
        self.from_outside(lambda: self.tell(kind, lasts=True, **content))

    def from_outside(self, act: Callable[[], None]) -> None:
        """Let the server's thread do something, from any thread; in the order asked for."""
        if self._server is not None:
            with suppress(RuntimeError):  # the server has ended; nobody watches any more
                self._server.call_soon_threadsafe(act)

    async def pump(self, health: Callable[[], dict[str, Any]]) -> None:
        """Serve the viewers until cancelled.

        Args:
            health: Says how loop, recorder and device are.
        """
        self._server = asyncio.get_running_loop()
        async with asyncio.TaskGroup() as tasks:
            tasks.create_task(self._pump_steps())
            tasks.create_task(self._pump_health(health))

    async def _pump_steps(self) -> None:
        while True:
            await self._fresh.wait()
            self._fresh.clear()
            self._pass_on_edges()
            newest, self._newest = self._newest, None
            ready = [viewer for viewer in self.viewers if viewer.is_ready]
            if newest is not None and ready:
                self._number += 1
                image = self._packed(*newest)
                for viewer in ready:
                    viewer.show(self._number, image)

    async def _pump_health(self, health: Callable[[], dict[str, Any]]) -> None:
        while True:
            if self.viewers:
                self.tell("health", **health())
            await asyncio.sleep(HEALTH_S)

    def _pass_on_edges(self) -> None:
        edges = []
        while self._edges:
            stamp_ns, amplitude, frequency_hz = self._edges.popleft()
            edges.append((self.to_ms(stamp_ns), amplitude, frequency_hz))
        if edges:
            self.tell("touch", edges=edges)

    def _packed(self, capture: Capture, step: Step) -> bytes:
        """Write the message of one step, once for all viewers."""
        picture = b""
        if capture.image is not None and self._view is not None:
            picture = encode_jpeg(self._view(capture.image), JPEG_QUALITY)
        header = shown(
            step,
            self._moving,
            number=self._number,
            time_ms=self.to_ms(step.stamp_ns),
            commanded_ms=self.to_ms(step.timing.commanded_ns if step.timing else step.stamp_ns),
            has_picture=bool(picture),
            hand=capture.hand,
        )
        return packed(header, picture)
