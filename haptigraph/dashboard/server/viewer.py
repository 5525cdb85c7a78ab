"""One page that watches: a queue of texts, and only the newest image. Used in the server's thread."""

import asyncio
from collections import deque

__all__ = ["Viewer"]

MAX_IN_FLIGHT = 2  # images sent that the page has not acknowledged
MAX_TEXTS = 256


class Viewer:
    """One page.

    Args:
        name: Its name on other pages.
        may_steer: Whether it may do more than watch.
        is_blind: Whether it receives only what `blinding` leaves.
        is_local: Whether its browser runs on this machine.
    """

    def __init__(
        self, name: str, *, may_steer: bool = True, is_blind: bool = False, is_local: bool = False
    ) -> None:
        self.name, self.may_steer, self.is_blind, self.is_local = name, may_steer, is_blind, is_local
        self.wants_images = True
        self.outputs: tuple[str, ...] = ()
        """The page's outputs that somebody at it can feel, see or hear."""
        self.missed = 0
        """Images that the page was too slow for."""
        self._in_flight: deque[int] = deque()
        self._image: tuple[int, bytes] | None = None
        self._texts: deque[str] = deque(maxlen=MAX_TEXTS)
        self._wakeup = asyncio.Event()

    @property
    def is_ready(self) -> bool:
        """Whether another image may be sent."""
        return self.wants_images and len(self._in_flight) < MAX_IN_FLIGHT

    def put_image(self, number: int, message: bytes) -> None:
        """Leave an image message; it replaces one that was not fetched."""
        self.missed += self._image is not None
        self._image = number, message
        self._wakeup.set()

    def put_text(self, text: str) -> None:
        """Leave a text message."""
        self._texts.append(text)
        self._wakeup.set()

    def acknowledge(self, number: int) -> None:
        """Note that an image, and all before it, have arrived."""
        while self._in_flight and self._in_flight[0] <= number:
            self._in_flight.popleft()

    async def next(self) -> str | bytes:
        """Wait for the next message to send: texts in order, then the newest image."""
        while True:
            if self._texts:
                return self._texts.popleft()
            if self._image is not None:
                (number, message), self._image = self._image, None
                self._in_flight.append(number)
                return message
            self._wakeup.clear()
            await self._wakeup.wait()
