"""Read sources faster than the loop: ahead of it in a second thread, or to the end without a loop.

Picks images that are evenly spread over a source of unknown length.
"""

import threading
from collections.abc import Generator
from queue import Empty, SimpleQueue

from haptigraph.errors import EndOfSource
from haptigraph.messages import Capture, Image
from haptigraph.semaphore import InterruptSafeSemaphore
from haptigraph.sources.wrapper import SourceWrapper
from haptigraph.stages import Source

__all__ = ["ReadAhead", "SpreadImages", "read_images"]

DEPTH = 4
POLL_S = 0.1
READ_TIMEOUT_S = 1.0


class ReadAhead(SourceWrapper):
    """Read another source in a thread, in order, a few captures ahead.

    Args:
        source: A source that is not live; only the thread reads it.
        waits: Whether `read` ignores its timeout: True where nothing is controlled in real time.
    """

    def __init__(self, source: Source, *, waits: bool) -> None:
        super().__init__(source)
        self._waits = waits
        self._ready: SimpleQueue[Capture | BaseException] = SimpleQueue()
        self._slots = InterruptSafeSemaphore(DEPTH)
        self._ended: BaseException | None = None
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._read, name="haptigraph-read-ahead", daemon=True)
        self._thread.start()

    def read(self, timeout_s: float) -> Capture | None:
        """Return the next capture, None if it is not ready in time, or raise what the source raised."""
        if self._ended is None:
            try:
                item = self._ready.get(timeout=None if self._waits else timeout_s)
            except Empty:
                return None
            self._slots.release()
            if isinstance(item, Capture):
                return item
            self._ended = item
        raise self._ended

    def close(self) -> None:
        """Stop reading and close the source."""
        self._closing.set()
        self._thread.join()
        self._source.close()

    def _read(self) -> None:
        last = False
        while not last and not self._closing.is_set():
            try:
                item: Capture | BaseException | None = self._source.read(POLL_S)
            except BaseException as error:  # `read` raises it in the loop's thread
                item, last = error, True
            if item is not None:
                self._put(item)

    def _put(self, item: Capture | BaseException) -> None:
        while not self._closing.is_set():
            if self._slots.acquire(POLL_S):
                return self._ready.put(item)


def read_images(source: Source) -> Generator[Capture, None, None]:
    """Yield every capture that has an image, as fast as the source delivers, and close the source."""
    try:
        while True:
            capture = source.read(READ_TIMEOUT_S)
            if capture is not None and capture.image is not None:
                yield capture
    except EndOfSource:
        return
    finally:
        source.close()


class SpreadImages:
    """Images evenly spread over a source of unknown length; `add` them all in order.

    Args:
        max_images: How many to pick at most.
    """

    def __init__(self, max_images: int) -> None:
        self._max_images = max_images
        self._count, self._step = 0, 1
        self.held: list[Image] = []
        """Those from which it picks, fewer than twice as many."""

    def add(self, image: Image) -> None:
        """Process the next image."""
        if self._count % self._step == 0:
            self.held.append(image)
        if len(self.held) == 2 * self._max_images:
            self.held, self._step = self.held[::2], 2 * self._step
        self._count += 1

    @property
    def picked(self) -> list[Image]:
        """The images, in order."""
        count = min(self._max_images, len(self.held))
        last = len(self.held) - 1
        return [self.held[round(number * last / max(count - 1, 1))] for number in range(count)]
