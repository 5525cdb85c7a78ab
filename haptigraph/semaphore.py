"""A counting semaphore that Ctrl-C cannot corrupt, for queues between the loop and a thread.

A KeyboardInterrupt may strike the loop between acquiring a lock and recording that it is held; the thread
would then wait for ever. `queue.SimpleQueue` is atomic, so the semaphore is built on it, as the queues are.
"""

from queue import Empty, SimpleQueue

__all__ = ["InterruptSafeSemaphore"]


class InterruptSafeSemaphore:
    """Slots that any thread may acquire and release.

    Args:
        slots: Their number.
    """

    def __init__(self, slots: int) -> None:
        self._free: SimpleQueue[None] = SimpleQueue()
        for _ in range(slots):
            self._free.put(None)

    def acquire(self, timeout_s: float | None) -> bool:
        """Acquire a slot and return True, or False if none becomes free in time; None waits for ever."""
        try:
            self._free.get(timeout=timeout_s)
        except Empty:
            return False
        return True

    def release(self) -> None:
        """Free a slot."""
        self._free.put(None)
