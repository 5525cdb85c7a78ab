"""A text device: one live line in the terminal, for users without an actuator."""

import sys
from typing import TextIO

from haptigraph.errors import BadInput
from haptigraph.messages import Capabilities

__all__ = ["ConsoleDevice"]

WIDTH = 20


class ConsoleDevice:
    """Show the amplitude as a bar, if the output is a terminal.

    Args:
        argument: Must be empty.
        stream: The output; standard error if None.

    Raises:
        BadInput: If an argument is given.
    """

    capabilities = Capabilities(
        amplitude_levels=WIDTH,
        frequency_range_hz=(0.0, 1000.0),
        shortest_on_ms=0.0,
        limitations="Amplitudes are rounded to the nearest step of the bar.",
    )

    def __init__(self, argument: str = "", stream: TextIO | None = None) -> None:
        if argument:
            raise BadInput(f"device 'console' takes nothing behind a colon, found {argument!r}")
        self._stream: TextIO | None = stream or sys.stderr  # None in programs without a terminal
        self._is_terminal = self._stream is not None and self._stream.isatty()

    def set(self, amplitude: float, frequency_hz: float, stamp_ns: int) -> None:
        """Draw the bar."""
        bar = ("█" * round(amplitude * WIDTH)).ljust(WIDTH, "·")
        text = f"{amplitude:.2f} at {frequency_hz:3.0f} Hz" if amplitude else "silent"
        self._draw(f"\rhaptics {bar} {text:16}")

    def close(self) -> None:
        """Erase the line."""
        self._draw("\r\033[K")

    def _draw(self, text: str) -> None:
        if self._is_terminal and self._stream is not None:
            self._stream.write(text)
            self._stream.flush()
