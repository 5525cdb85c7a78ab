"""Between the loop and its viewers: keeps the newest step and gives it to every viewer that is ready.

The loop's thread leaves a step here in microseconds and goes on; everything else happens in the server's
thread. A slow viewer misses images but delays neither the loop nor another viewer.
"""

import asyncio
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from typing import Any

from haptigraph.clock import Clock
from haptigraph.dashboard.server.blinding import blind_health, blind_hello, blind_image
from haptigraph.dashboard.server.protocol import ImageHeader, image_header, pack, text_message
from haptigraph.dashboard.server.viewer import Viewer
from haptigraph.haptics.observed_device import DeliveryLog
from haptigraph.messages import Capture, Delivered, Fault, Step
from haptigraph.perception.eye_view import EyeView
from haptigraph.recording.codec import encode_jpeg

__all__ = ["Hub"]

JPEG_QUALITY = 80
MAX_EDGES = 1000
MAX_LATENCIES = 300
HEALTH_S = 0.5


class Hub:
    """A sink that viewers watch.

    Args:
        clock: The run's clock; messages carry milliseconds since the hub was created.
    """

    def __init__(self, clock: Clock) -> None:
        self.dropped = 0  # an image that a viewer misses is not lost data
        self.viewers: list[Viewer] = []
        self.latencies_ns: deque[int] = deque(maxlen=MAX_LATENCIES)
        """From capture to command, of the last steps."""
        self.last_faults: dict[str, tuple[float, str]] = {}
        """Time [ms] and message of the newest fault that is not reported as over, by where it occurred."""
        self.newest_capture: Capture | None = None
        """For pages that need the source's images."""
        self.deliveries = DeliveryLog()
        """What outputs of pages confirm; a loop's, so that it is recorded."""
        self.on_outputs: Callable[[], None] = lambda: None
        """Called in the server's thread when the outputs of pages change."""
        self._clock, self._origin_ns = clock, clock.now_ns()
        self._newest: tuple[Capture, Step] | None = None
        self._edges: deque[tuple[int, float, float]] = deque(maxlen=MAX_EDGES)
        self._server: asyncio.AbstractEventLoop | None = None
        self._wakeup = asyncio.Event()
        self._number = 0
        self._view: EyeView | None = None
        self._moving: frozenset[str] = frozenset()
        self._retained: dict[str, tuple[str, str]] = {}
        """Messages for viewers that join, by type: for all, and for blinded ones; empty: none."""

    # --- called in the loop's thread, and in the thread that drives the device ------------------------

    def write(self, capture: Capture, step: Step) -> None:
        """Leave the newest step."""
        if step.timing is not None:
            self.latencies_ns.append(step.timing.commanded_ns - step.stamp_ns)
        for fault in step.observation.faults:
            self.last_faults.pop(fault.where, None)
            if not fault.is_over:
                self.last_faults[fault.where] = self.to_ms(step.stamp_ns), fault.message
        self.newest_capture = capture
        self._newest = capture, step
        self._wake()

    def record_level(self, stamp_ns: int, amplitude: float, frequency_hz: float) -> None:
        """Leave a level that the guard sent to the device."""
        self._edges.append((stamp_ns, amplitude, frequency_hz))
        self._wake()

    def keep_alive(self, stamp_ns: int) -> None:
        """Let the pages play the last level for a while; without images, nothing else does."""
        self.call_threadsafe(lambda: self.publish("alive", time_ms=self.to_ms(stamp_ns)))

    def take_faults(self) -> tuple[Fault, ...]:
        """Return nothing: viewers that fail do not concern the loop."""
        return ()

    def close(self) -> None:
        """Do nothing: the server outlives the loop, so that pages can show how it ended."""

    def to_ms(self, stamp_ns: int) -> float:
        """Convert a stamp of the run's clock to the time in messages."""
        return round((stamp_ns - self._origin_ns) / 1e6, 3)

    def now_ms(self) -> float:
        """Return the present as the time in messages."""
        return self.to_ms(self._clock.now_ns())

    def _wake(self) -> None:
        if self._server is not None and self.viewers:
            try:
                self._server.call_soon_threadsafe(self._wakeup.set)
            except RuntimeError:  # the server has stopped; there are no viewers any more
                self._server = None

    # --- called in the server's thread ----------------------------------------------------------------

    def announce(self, hello: dict[str, Any], view: EyeView, moving: frozenset[str]) -> None:
        """Serve another run; call before the server starts, or in its thread.

        Args:
            hello: Fields of the first message of the run, for every viewer.
            view: Renders the picture of an image.
            moving: Names of the entities whose positions go with every image.
        """
        self._retained.pop("ended", None)
        self._retained["hello"] = text_message("hello", **hello), text_message("hello", **blind_hello(hello))
        self._view, self._moving, self._newest, self.last_faults = view, moving, None, {}
        self._send(*self._retained["hello"])

    def join(self, viewer: Viewer) -> None:
        """Add a viewer and send it the retained messages."""
        for texts in self._retained.values():
            _put(viewer, *texts)
        self.viewers.append(viewer)

    def leave(self, viewer: Viewer) -> None:
        """Remove a viewer."""
        self.viewers.remove(viewer)
        if viewer.outputs:
            self.on_outputs()

    def set_outputs(self, viewer: Viewer, names: tuple[str, ...]) -> None:
        """Note which outputs of a page work at present."""
        viewer.outputs = names
        self.on_outputs()

    def log_played(self, output: str, start_ms: float, end_ms: float) -> None:
        """Log that an output of a page confirmed to have vibrated for a time, of which the future is cut."""
        start_ns, end_ns = (self._origin_ns + round(time_ms * 1e6) for time_ms in (start_ms, end_ms))
        self.deliveries.add(Delivered(start_ns, min(end_ns, self._clock.now_ns()), output))

    def publish(self, kind: str, *, retain: bool = False, **content: object) -> None:
        """Send a message to all viewers; viewers that join later get the newest retained one of each type."""
        text = text_message(kind, **content)
        if retain:
            self._retained[kind] = text, text
        self._send(text, text)

    def _send(self, text: str, blind_text: str) -> None:
        """Send a message to all viewers, and to blinded ones another, if it is not empty."""
        for viewer in self.viewers:
            _put(viewer, text, blind_text)

    def publish_threadsafe(self, kind: str, **content: object) -> None:
        """Send a retained message to all viewers, from any thread."""
        self.call_threadsafe(lambda: self.publish(kind, retain=True, **content))

    def call_threadsafe(self, act: Callable[[], None]) -> None:
        """Call a function in the server's thread, from any thread; calls keep their order."""
        if self._server is not None:
            with suppress(RuntimeError):  # the server has stopped; there are no viewers any more
                self._server.call_soon_threadsafe(act)

    async def pump(self, health: Callable[[], dict[str, Any]]) -> None:
        """Serve the viewers until cancelled.

        Args:
            health: Returns the fields of the health message.
        """
        self._server = asyncio.get_running_loop()
        async with asyncio.TaskGroup() as tasks:
            tasks.create_task(self._pump_steps())
            tasks.create_task(self._pump_health(health))

    async def _pump_steps(self) -> None:
        while True:
            await self._wakeup.wait()
            self._wakeup.clear()
            self._publish_edges()
            newest, self._newest = self._newest, None
            ready = [viewer for viewer in self.viewers if viewer.is_ready]
            if newest is not None and ready:
                self._number += 1
                header, picture = self._image(*newest)
                messages = {
                    is_blind: pack(blind_image(header) if is_blind else header, picture)
                    for is_blind in {viewer.is_blind for viewer in ready}
                }
                for viewer in ready:
                    viewer.put_image(self._number, messages[viewer.is_blind])

    async def _pump_health(self, health: Callable[[], dict[str, Any]]) -> None:
        while True:
            if self.viewers:
                fields = health()
                self._send(text_message("health", **fields), text_message("health", **blind_health(fields)))
            await asyncio.sleep(HEALTH_S)

    def _publish_edges(self) -> None:
        edges = []
        while self._edges:
            stamp_ns, amplitude, frequency_hz = self._edges.popleft()
            edges.append((self.to_ms(stamp_ns), amplitude, frequency_hz))
        if edges:
            self._send(text_message("haptics", edges=edges), "")
            self._retained["haptics"] = text_message("haptics", edges=edges[-1:]), ""

    def _image(self, capture: Capture, step: Step) -> tuple[ImageHeader, bytes]:
        """Return header and picture of one step, once for all viewers."""
        picture, view = b"", self._view
        if view is None:
            raise RuntimeError("a step was published before its run was announced")
        if capture.image is not None:
            picture = encode_jpeg(view(capture.image, step.observation.found), JPEG_QUALITY)
        header = image_header(
            capture,
            step,
            self._moving,
            view,
            number=self._number,
            time_ms=self.to_ms(step.stamp_ns),
            commanded_ms=self.to_ms(step.timing.commanded_ns if step.timing else step.stamp_ns),
            has_picture=bool(picture),
            hand=capture.hand,
        )
        return header, picture


def _put(viewer: Viewer, text: str, blind_text: str) -> None:
    """Leave a message for a viewer, and for a blinded one another, if it is not empty."""
    if chosen := blind_text if viewer.is_blind else text:
        viewer.put_text(chosen)
