"""A WebSocket in one thread, whose reads have a time limit.

Built on the protocol of the `websockets` library without its threads: at 1 kHz a hand-over between threads
would cost more than the conversation itself.
"""

import socket
from contextlib import suppress

from websockets.client import ClientProtocol
from websockets.exceptions import WebSocketException
from websockets.frames import Frame, Opcode
from websockets.protocol import State
from websockets.uri import parse_uri

__all__ = ["WebSocket"]

READ_SIZE = 1 << 16


class WebSocket:
    """One connection as a client.

    Args:
        host: Of the server.
        port: Of the server.
        within_s: How long connecting may take.

    Raises:
        OSError: If there is no server, or it does not answer as one.
    """

    def __init__(self, host: str, port: int, within_s: float) -> None:
        self._parts: list[bytes] = []
        self._texts: list[bytes] = []
        self._socket = socket.create_connection((host, port), within_s)
        try:
            self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            self._protocol = ClientProtocol(parse_uri(f"ws://{host}:{port}"))
            self._protocol.send_request(self._protocol.connect())
            self._flush()
            while self._protocol.state is State.CONNECTING:
                self._receive()
            if self._protocol.handshake_exc is not None:
                raise OSError(f"no WebSocket: {self._protocol.handshake_exc}")
        except BaseException:
            self._socket.close()
            raise

    def send(self, text: bytes) -> None:
        """Send a text message.

        Raises:
            OSError: If the connection is lost.
        """
        try:
            self._protocol.send_text(text)
        except WebSocketException:
            raise OSError("the connection is closed") from None
        self._flush()

    def receive(self, within_s: float) -> list[bytes]:
        """Return the text messages that have arrived, oldest first; wait for the first one, if need be.

        Raises:
            OSError: If the connection is lost.
        """
        self._socket.settimeout(max(within_s, 1e-6))
        with suppress(TimeoutError):
            while not self._texts:
                if self._protocol.state is not State.OPEN:
                    raise OSError("the service closed the connection")
                self._receive()
        texts, self._texts = self._texts, []
        return texts

    def close(self) -> None:
        """Close the connection. May be called twice."""
        with suppress(OSError, WebSocketException):  # lost before
            self._protocol.send_close()
            self._flush()
        self._socket.close()

    def _receive(self) -> None:
        data = self._socket.recv(READ_SIZE)
        if data:
            self._protocol.receive_data(data)
        else:
            self._protocol.receive_eof()
        self._take_frames()
        with suppress(OSError):  # lost: what has arrived still counts
            self._flush()  # the answer to a ping or to a close

    def _take_frames(self) -> None:
        for event in self._protocol.events_received():
            if isinstance(event, Frame) and event.opcode in (Opcode.TEXT, Opcode.CONT):
                self._parts.append(bytes(event.data))
                if event.fin:
                    self._texts.append(b"".join(self._parts))
                    self._parts = []

    def _flush(self) -> None:
        for data in self._protocol.data_to_send():
            if data:
                self._socket.sendall(data)
