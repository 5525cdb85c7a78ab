"""A device made of text: one live line in the terminal, for those who have no actuator yet."""

import sys
from typing import TextIO

from haptigraph.messages import Capabilities

__all__ = ["ConsoleDevice"]

WIDTH = 20


class ConsoleDevice:
    """Show the amplitude as a bar. Draws nothing where the output is not a terminal.

    Args:
        stream: Where to draw; standard error if None.
    """

    capabilities = Capabilities(amplitude_levels=WIDTH, frequency_range_hz=(0.0, 1000.0), shortest_on_ms=0.0)

    def __init__(self, stream: TextIO | None = None) -> None:
        self._stream: TextIO | None = stream or sys.stderr  # None in programs without any terminal
        self._draws = self._stream is not None and self._stream.isatty()

    def set(self, amplitude: float, frequency_hz: float, stamp_ns: int) -> None:
        """Draw the bar."""
        bar = ("█" * round(amplitude * WIDTH)).ljust(WIDTH, "·")
        told = f"{amplitude:.2f} at {frequency_hz:3.0f} Hz" if amplitude else "silent"
        self._draw(f"\rtouch {bar} {told:16}")

    def close(self) -> None:
        """Wipe the line."""
        self._draw("\r\033[K")

    def _draw(self, text: str) -> None:
        if self._draws and self._stream is not None:
            self._stream.write(text)
            self._stream.flush()
