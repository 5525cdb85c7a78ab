"""Places in a queue between the loop and a thread, as many as may wait there.

Ctrl-C strikes the loop anywhere, also between taking a lock and noting that it is held, and then the thread
waits for ever. Behind these places is `queue.SimpleQueue`, as it should be behind the queue itself: the
interpreter works it in one step. Knows no queue.
"""

from queue import Empty, SimpleQueue

__all__ = ["InterruptSafeSemaphore"]


class InterruptSafeSemaphore:
    """Places that are taken and given back, by anyone.

    Args:
        places: How many there are.
    """

    def __init__(self, places: int) -> None:
        self._free: SimpleQueue[None] = SimpleQueue()
        for _ in range(places):
            self._free.put(None)

    def take(self, within_s: float | None) -> bool:
        """Take a place, if one gets free in time; None: however long it takes."""
        try:
            self._free.get(timeout=within_s)
        except Empty:
            return False
        return True

    def give_back(self) -> None:
        """Let another have a place."""
        self._free.put(None)
