"""Keep a run in a file without holding up the loop: a bounded queue and a thread that writes.

In real time what does not fit the queue loses its image and is counted; otherwise the loop waits.
"""

import threading
from queue import SimpleQueue

from msgspec.structs import replace

from haptigraph.messages import Capture, Fault, Step
from haptigraph.recording.writer import Progress, RunWriter
from haptigraph.semaphore import InterruptSafeSemaphore

__all__ = ["Recorder"]

MOST_IMAGES = 24  # under a second at 30 images/s, so that a killed process loses no more than that
MOST_STEPS = 3000


class Recorder:
    """Write steps in the background.

    Args:
        writer: The new recording.
        waits: Whether the loop may wait for the disk: True where nothing is controlled in real time.
        progress: Told how far the compaction at the end is.
    """

    def __init__(self, writer: RunWriter, *, waits: bool, progress: Progress | None = None) -> None:
        self.dropped = 0
        self._unwritten = 0  # counted by the thread, told when it has ended
        self._writer, self._progress = writer, progress
        self._patience_s = None if waits else 0.0
        self._queue: SimpleQueue[tuple[Capture, Step, bool] | None] = SimpleQueue()
        self._step_room, self._image_room = (
            InterruptSafeSemaphore(MOST_STEPS),
            InterruptSafeSemaphore(MOST_IMAGES),
        )
        self._faults: list[Fault] = []
        self._failed = threading.Event()
        self._thread = threading.Thread(target=self._drain, name="haptigraph-recorder", daemon=True)
        self._thread.start()

    def write(self, capture: Capture, step: Step) -> None:
        """Queue one step."""
        if self._failed.is_set():
            self.dropped += 1
            return
        dropped = capture.image is not None and not self._image_room.take(self._patience_s)
        if dropped:
            self.dropped += 1
            capture = replace(capture, image=None, encoded=None)
        if self._step_room.take(self._patience_s):
            self._queue.put((capture, step, dropped))
            return
        self.dropped += not dropped
        if capture.image is not None:
            self._image_room.give_back()

    def take_faults(self) -> tuple[Fault, ...]:
        """Return what went wrong since last asked."""
        faults, self._faults = tuple(self._faults), []
        return faults

    def close(self) -> None:
        """Write what is queued, finish and compact the file."""
        if not self._thread.is_alive():
            return
        self._queue.put(None)
        self._thread.join()
        self.dropped += self._unwritten
        try:
            if not self._failed.is_set():
                self._writer.close(self._progress)
        except Exception as error:
            self._fail(error)

    def _drain(self) -> None:
        while (item := self._queue.get()) is not None:
            capture, step, dropped = item
            if not (self._wrote(capture, step, dropped) or dropped):
                self._unwritten += 1
            self._step_room.give_back()
            if capture.image is not None:
                self._image_room.give_back()

    def _wrote(self, capture: Capture, step: Step, dropped: bool) -> bool:
        if self._failed.is_set():
            return False
        try:
            self._writer.write(capture, step, dropped=dropped)
        except Exception as error:  # whatever it is, the loop must not wait for a dead thread
            self._fail(error)
            return False
        return True

    def _fail(self, error: Exception) -> None:
        self._failed.set()
        self._writer.abandon()
        reason = error.strerror if isinstance(error, OSError) else f"{type(error).__name__}: {error}"
        told = f"incomplete ({reason}); it can be recovered"
        if self._writer.is_complete:
            told = f"complete but not compacted ({reason})"
        self._faults.append(Fault("recorder", f"{self._writer.path} is {told}"))
