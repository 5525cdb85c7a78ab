"""The keys of a terminal as a leader. A terminal does not say when a key is released.

So each press moves for `HELD_NS` and no longer; a key that repeats while it is held goes on moving.
"""

import os
import re
import select
import sys
from collections.abc import Sequence
from contextlib import suppress
from typing import Any

from haptigraph.clock import Clock
from haptigraph.errors import BadInput, DeviceError
from haptigraph.teleop.motion import HandMotion

try:
    import termios
    import tty
except ImportError:  # Windows
    termios = tty = None  # type: ignore[assignment]

__all__ = ["KeysLeader"]

HELP = (
    "keys: arrows or WASD in, out and sideways; R, F out of and into the picture; O, C open, close the jaws"
)
HELD_NS = 100_000_000
SPEED_MM_S = 10.0
KEY = re.compile(rb"(\x1b[\[O].|[^\x1b])", re.DOTALL)
"""A key: of a cursor key a sequence, of the others one byte."""
KEYS: dict[bytes, tuple[str, int]] = {
    **dict.fromkeys((b"\x1b[B", b"\x1bOB", b"s"), ("along_mm", 1)),
    **dict.fromkeys((b"\x1b[A", b"\x1bOA", b"w"), ("along_mm", -1)),
    **dict.fromkeys((b"\x1b[C", b"\x1bOC", b"d"), ("across_mm", 1)),
    **dict.fromkeys((b"\x1b[D", b"\x1bOD", b"a"), ("across_mm", -1)),
    b"r": ("outwards_mm", 1),
    b"f": ("outwards_mm", -1),
    b"o": ("apart_mm", 1),
    b"c": ("apart_mm", -1),
}
MAX_READ = 1024


class KeysLeader:
    """Read the keys of the terminal from which the program was started; Ctrl-C keeps its meaning.

    Args:
        argument: Empty.
        clock: Measures for how long a press moves.

    Raises:
        BadInput: If there is no terminal, or it is one of Windows.
    """

    def __init__(self, argument: str, clock: Clock) -> None:
        if argument:
            raise BadInput(f"leader keys:{argument}: keys takes no argument")
        if termios is None:
            raise BadInput("leader keys needs a terminal of Linux or macOS; use gamepad:0")
        try:
            self._descriptor = sys.stdin.fileno()
        except (AttributeError, OSError, ValueError):  # None, replaced, or closed
            self._descriptor = -1
        if not os.isatty(self._descriptor):
            raise BadInput("leader keys needs a terminal; standard input is none")
        self._clock, self._last_ns = clock, clock.now_ns()
        self._pressed, self._until_ns = ("", 0), 0
        self._unread = b""
        self._before: list[Any] | None = termios.tcgetattr(self._descriptor)
        tty.setcbreak(self._descriptor)

    @staticmethod
    def found() -> dict[str, str]:
        """Return that keys are always there, and what they do."""
        return {"keys": HELP}

    def take(self) -> Sequence[HandMotion]:
        """Return the motion since the last call."""
        now_ns = self._clock.now_ns()
        held_ns = max(min(now_ns, self._until_ns) - self._last_ns, 0)
        (axis, sign), self._last_ns = self._pressed, now_ns
        for key in self._read_keys():
            if key in KEYS:
                self._pressed, self._until_ns = KEYS[key], now_ns + HELD_NS
        if held_ns:
            return (HandMotion(True, **{axis: sign * SPEED_MM_S * held_ns / 1e9}),)
        return (HandMotion(engaged=now_ns < self._until_ns),)

    def close(self) -> None:
        """Restore the terminal."""
        before, self._before = self._before, None
        if before is not None:
            with suppress(termios.error):  # it is closed
                termios.tcsetattr(self._descriptor, termios.TCSADRAIN, before)

    def _read_keys(self) -> list[bytes]:
        """Return the keys that were pressed since the last call, without waiting.

        Raises:
            DeviceError: If the terminal is closed.
        """
        if not select.select([self._descriptor], [], [], 0)[0]:
            return []
        try:
            data = os.read(self._descriptor, MAX_READ)
        except OSError:
            data = b""
        if not data:
            raise DeviceError("the terminal is closed")
        *keys, self._unread = KEY.split(self._unread + data)
        return [key for key in keys if key]
