"""Keep file descriptors for a process that must start whatever else the program has opened."""

import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress

__all__ = ["DescriptorReserve"]


class DescriptorReserve:
    """Hold file descriptors, so that a program that has used up all others can still start a process.

    Args:
        count: Their number.
    """

    def __init__(self, count: int) -> None:
        self._count = count
        self._held: list[int] = []
        self._fill()

    @contextmanager
    def released(self) -> Iterator[None]:
        """Release them while a process starts."""
        self.release()
        try:
            yield
        finally:
            self._fill()

    def release(self) -> None:
        """Release them for good."""
        while self._held:
            os.close(self._held.pop())

    def _fill(self) -> None:
        with suppress(OSError):  # fewer than wanted are left
            while len(self._held) < self._count:
                self._held.append(os.open(os.devnull, os.O_RDONLY))
