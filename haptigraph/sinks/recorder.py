"""Record a run without delaying the loop: a bounded queue and a writer thread.

In real time, steps that do not fit the queue lose their image and are counted; otherwise the loop waits.
"""

import threading
from collections import deque
from queue import SimpleQueue

from msgspec.structs import replace

from haptigraph.errors import BadInput
from haptigraph.messages import Capture, Fault, Step
from haptigraph.recording.journal import FileChanged
from haptigraph.recording.writer import Progress, RunWriter
from haptigraph.semaphore import InterruptSafeSemaphore

__all__ = ["Recorder"]

MAX_IMAGES = 24  # less than a second at 30 images/s, which is the most that a killed process loses
MAX_STEPS = 3000


class Recorder:
    """Write steps in the background.

    Args:
        writer: The new recording.
        waits: Whether the loop may wait for the disk: True if nothing is controlled in real time.
        progress: Reports the progress of the final compaction.
    """

    def __init__(self, writer: RunWriter, *, waits: bool, progress: Progress | None = None) -> None:
        self.dropped = 0
        self._unwritten = 0  # counted by the thread, added to `dropped` after it has ended
        self._writer, self._progress = writer, progress
        self._timeout_s = None if waits else 0.0
        self._queue: SimpleQueue[tuple[Capture, Step, bool] | None] = SimpleQueue()
        self._step_slots, self._image_slots = map(InterruptSafeSemaphore, (MAX_STEPS, MAX_IMAGES))
        self._faults: deque[Fault] = deque()
        self._failed = threading.Event()
        self._thread = threading.Thread(target=self._drain, name="haptigraph-recorder", daemon=True)
        self._thread.start()

    def write(self, capture: Capture, step: Step) -> None:
        """Queue one step."""
        if self._failed.is_set():
            self.dropped += 1
            return
        dropped = capture.image is not None and not self._image_slots.acquire(self._timeout_s)
        if dropped:
            self.dropped += 1
            capture = replace(capture, image=None, encoded=None)
        if self._step_slots.acquire(self._timeout_s):
            self._queue.put((capture, step, dropped))
            return
        self.dropped += not dropped
        if capture.image is not None:
            self._image_slots.release()

    def take_faults(self) -> tuple[Fault, ...]:
        """Return the faults since the last call."""
        return tuple(self._faults.popleft() for _ in range(len(self._faults)))  # the thread may append one

    def close(self) -> None:
        """Write the queue, finish and compact the file."""
        if not self._thread.is_alive():
            return
        self._queue.put(None)
        self._thread.join()
        try:
            if not self._failed.is_set():
                self._writer.close(self._progress)
        except Exception as error:
            self._fail(error)
        self.dropped += self._unwritten

    def _drain(self) -> None:
        last = None
        while (item := self._queue.get()) is not None:
            capture, step, dropped = item
            if step is not last and not (self._wrote(capture, step, dropped) or dropped):
                self._unwritten += 1
            last = step
            self._step_slots.release()
            if capture.image is not None:
                self._image_slots.release()

    def _wrote(self, capture: Capture, step: Step, dropped: bool) -> bool:
        if self._failed.is_set():
            return False
        try:
            self._writer.write(capture, step, dropped=dropped)
            self._faults += (Fault("recorder", problem) for problem in self._writer.take_problems())
        except Exception as error:  # the thread must survive, because the loop waits for it
            self._fail(error)
            return False
        return True

    def _fail(self, error: Exception) -> None:
        self._failed.set()
        reason = f"{type(error).__name__}: {error}"
        if isinstance(error, OSError) and error.strerror:
            reason = error.strerror
        self._writer.abandon("" if isinstance(error, FileChanged) else reason)
        result = f"incomplete ({reason}); later steps are lost, earlier ones can be recovered"
        if self._writer.is_complete:
            result = f"complete but not compacted ({reason})"
        elif isinstance(error, FileChanged):
            result = f"incomplete ({error})"
            self._unwritten += self._writer.steps  # whatever was written may be gone
        elif isinstance(error, BadInput):
            result = f"incomplete ({error.problem})"
        self._faults.append(Fault("recorder", f"{self._writer.path} is {result}"))
