"""Make the next images while the loop works on this one: files and simulators on a second core."""

import threading
from queue import Empty, SimpleQueue

from haptigraph.messages import Capture
from haptigraph.semaphore import InterruptSafeSemaphore
from haptigraph.stages import Source

__all__ = ["ReadAhead"]

DEPTH = 4
POLL_S = 0.1


class ReadAhead:
    """Read another source in a thread, in order, a few captures ahead.

    Args:
        source: A source that is not live; only the thread touches it.
        waits: Whether reading waits however long it takes: True where nothing is controlled in real time.
    """

    is_live = False

    def __init__(self, source: Source, *, waits: bool) -> None:
        self.rate_hz, self.registration = source.rate_hz, source.registration
        self.notes = getattr(source, "notes", ())
        self._source, self._waits = source, waits
        self._ready: SimpleQueue[Capture | BaseException] = SimpleQueue()
        self._room = InterruptSafeSemaphore(DEPTH)
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
            self._room.give_back()
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
            except BaseException as error:  # whatever it is, it belongs to the loop
                item, last = error, True
            if item is not None:
                self._put(item)

    def _put(self, item: Capture | BaseException) -> None:
        while not self._closing.is_set():
            if self._room.take(POLL_S):
                return self._ready.put(item)
