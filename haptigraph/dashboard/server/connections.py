"""Bound what visitors can use up before they are known: connections, time for a request, lines in the log."""

import asyncio
import logging
import sys
import traceback
from collections import Counter
from contextlib import suppress
from pathlib import Path
from typing import Any

import h11
from uvicorn.protocols.http.h11_impl import H11Protocol

__all__ = ["BoundedConnection", "BoundedLog"]

MAX_CONNECTIONS = 100
REQUEST_S = 10.0
MAX_KINDS, MAX_TEXT = 50, 300  # of problems in the log; characters of each


class BoundedConnection(H11Protocol):
    """A connection that must complete each request in `REQUEST_S`, one of at most `MAX_CONNECTIONS`.

    If there are too many, the one that has kept the server waiting longest is closed. Sockets of viewers are
    counted, but never closed.
    """

    began_s = 0.0
    """When the server began to wait for a request, on the event loop's clock."""
    _timeout: asyncio.TimerHandle | None = None
    _is_socket = False

    def connection_made(self, transport: Any) -> None:
        """Accept a connection."""
        super().connection_made(transport)
        self._watch()
        if len(self.connections) > MAX_CONNECTIONS:
            waiting = (other for other in self.connections if isinstance(other, BoundedConnection))
            min((other for other in waiting if other.is_waiting), key=lambda other: other.began_s).end()

    def connection_lost(self, exc: Exception | None) -> None:
        """Forget a connection."""
        self._unwatch()
        super().connection_lost(exc)

    def data_received(self, data: bytes) -> None:
        """Process a part of a request."""
        super().data_received(data)
        if not self.is_waiting:
            self._unwatch()
        elif self._timeout is None:  # the next request on this connection has begun
            self._watch()

    def handle_websocket_upgrade(self, event: h11.Request) -> None:
        """Become a viewer's socket."""
        self._is_socket = True
        super().handle_websocket_upgrade(event)

    @property
    def is_waiting(self) -> bool:
        """Whether the request is incomplete."""
        return not self._is_socket and self.conn.their_state in (h11.IDLE, h11.SEND_BODY)

    def end(self) -> None:
        """Close the connection at once."""
        self._unwatch()
        self.connections.discard(self)
        self.transport.abort()

    def _watch(self) -> None:
        self.began_s = self.loop.time()
        self._timeout = self.loop.call_later(REQUEST_S, self.end)

    def _unwatch(self) -> None:
        if self._timeout is not None:
            self._timeout.cancel()
            self._timeout = None


class BoundedLog(logging.Handler):
    """Print each kind of the server's problems once, in one line, and at the end how often each came."""

    LOGGERS = ("asyncio", "uvicorn.error")

    def __init__(self) -> None:
        super().__init__(logging.WARNING)
        self._counts: Counter[str] = Counter()

    def __enter__(self) -> "BoundedLog":
        for name in self.LOGGERS:
            logging.getLogger(name).addHandler(self)
        return self

    def __exit__(self, *_: object) -> None:
        for name in self.LOGGERS:
            logging.getLogger(name).removeHandler(self)
        for kind, count in self._counts.items():
            if count > 1:
                _print(f"{count} x {kind}")

    def emit(self, record: logging.LogRecord) -> None:
        """Print a problem unless it was printed before."""
        kind = record.getMessage().partition("\n")[0]
        if record.exc_info and record.exc_info[1] is not None:
            kind = f"{kind.rstrip(': ')}: {_described(record.exc_info[1])}"
        if len(self._counts) >= MAX_KINDS and kind not in self._counts:
            kind = "other problems"
        self._counts[kind] += 1
        if self._counts[kind] == 1:
            _print(kind)


def _described(error: BaseException) -> str:
    """Return an error and, for a report, where in the software it was raised."""
    *_, place = traceback.extract_tb(error.__traceback__) or [None]
    where = f" ({Path(place.filename).name}, line {place.lineno})" if place else ""
    return f"{type(error).__name__}: {error}{where}"


def _print(text: str) -> None:
    with suppress(OSError):  # a closed terminal
        sys.stderr.write(f"haptigraph: server: {text[:MAX_TEXT]}\n")
