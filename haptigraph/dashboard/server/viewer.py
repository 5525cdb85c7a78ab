"""One page that watches: a mailbox that holds the texts it has not fetched, and only the newest image.

Lives in the server's thread.
"""

import asyncio
from collections import deque

__all__ = ["Viewer"]

MOST_IN_FLIGHT = 2  # images sent that the page has not acknowledged
MOST_TEXTS = 256


class Viewer:
    """One page.

    Args:
        name: What others call it.
    """

    def __init__(self, name: str) -> None:
        self.name = name
        self.wants_images = True
        self.missed = 0
        """Images it was too slow for."""
        self._in_flight: deque[int] = deque()
        self._image: tuple[int, bytes] | None = None
        self._texts: deque[str] = deque(maxlen=MOST_TEXTS)
        self._news = asyncio.Event()

    @property
    def is_ready(self) -> bool:
        """Whether another image may be sent."""
        return self.wants_images and len(self._in_flight) < MOST_IN_FLIGHT

    def show(self, number: int, image: bytes) -> None:
        """Leave an image, in place of one that was not fetched."""
        self.missed += self._image is not None
        self._image = number, image
        self._news.set()

    def tell(self, text: str) -> None:
        """Leave a text."""
        self._texts.append(text)
        self._news.set()

    def acknowledge(self, number: int) -> None:
        """Note that the image of a number, and all before it, have arrived."""
        while self._in_flight and self._in_flight[0] <= number:
            self._in_flight.popleft()

    async def next(self) -> str | bytes:
        """Wait for what is to be sent next: texts in order, then the newest image."""
        while True:
            if self._texts:
                return self._texts.popleft()
            if self._image is not None:
                (number, image), self._image = self._image, None
                self._in_flight.append(number)
                return image
            self._news.clear()
            await self._news.wait()
