"""Serve needle and state over OpenIGTLink, live for 3D Slicer.

Frame: RAS in millimetres, as in Slicer. The eye frame becomes R = x (for a surgeon at the head of a supine
patient, the patient's right is on the right), A = y (from the retina to the front), S = z (out of the image).
"""

import socket
import time
from collections.abc import Iterable

from haptigraph.bridges.bridge import RunContext
from haptigraph.bridges.igtl_messages import string, transform
from haptigraph.bridges.needle_pose import found_needle, needle_matrix
from haptigraph.bridges.opening import parse_address
from haptigraph.errors import BadInput
from haptigraph.messages import Capture, Step

__all__ = ["OpenIgtLink"]

PORT = 18944
NEEDLE, STATE = "NeedleToEye", "SurgicalState"
STALL_TIMEOUT_S = 5.0
MAX_CLIENTS = 8


class OpenIgtLink:
    """A server for up to eight clients; a slow one misses steps, a stalled one is disconnected.

    Args:
        argument: PORT or HOST:PORT; empty: 18944 on this machine.
        run: The run to publish.

    Raises:
        BadInput: If it cannot listen at this address.
    """

    def __init__(self, argument: str, run: RunContext) -> None:
        self._utc_offset_ns = run.info.utc_offset_ns
        host, port = parse_address(argument, "openigtlink", PORT)
        try:
            self._listener = socket.create_server(
                (host, port), family=socket.AF_INET6 if ":" in host else socket.AF_INET
            )
        except OSError as error:
            raise BadInput(f"bridge openigtlink cannot listen at {host}:{port} ({error.strerror})") from None
        self._listener.setblocking(False)
        self.port: int = self._listener.getsockname()[1]
        self._clients: list[_Client] = []
        self._problems: list[str] = []

    def send_step(self, capture: Capture, step: Step) -> None:
        """Send every client the state, and the pose of the needle if its tip was detected."""
        self._accept()
        if not self._clients:
            return
        utc_ns = step.stamp_ns + self._utc_offset_ns
        data = string(STATE, utc_ns, step.conclusion.state)
        if needle := found_needle(step.observation):
            data += transform(NEEDLE, utc_ns, needle_matrix(*needle))
        self._keep(client for client in self._clients if client.send(data))

    def send_output(self, stamp_ns: int, amplitude: float, frequency_hz: float) -> None:
        """Do nothing: Slicer has no use for it."""

    def take_problems(self) -> tuple[str, ...]:
        """Return which clients were disconnected because they stalled."""
        problems, self._problems = tuple(self._problems), []
        return problems

    def close(self) -> None:
        """Disconnect all clients and stop listening."""
        self._keep(())
        self._listener.close()

    def _accept(self) -> None:
        while len(self._clients) < MAX_CLIENTS:
            try:
                connection, _ = self._listener.accept()
            except BlockingIOError:
                return
            self._clients.append(_Client(connection))

    def _keep(self, clients: Iterable["_Client"]) -> None:
        kept = list(clients)
        for client in self._clients:
            if client not in kept:
                client.close()
                if client.is_stalled:
                    self._problems.append(f"a client stalled for {STALL_TIMEOUT_S:g} s and was disconnected")
        self._clients = kept


class _Client:
    """One non-blocking connection, which receives whole messages only."""

    def __init__(self, connection: socket.socket) -> None:
        connection.setblocking(False)
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._connection = connection
        self._unsent = memoryview(b"")
        self._progress_s = time.monotonic()
        self.is_stalled = False

    def send(self, data: bytes) -> bool:
        """Send data, unless older data is still unsent; return whether to keep the client."""
        if not self._is_connected():
            return False
        if not self._unsent:
            self._unsent = memoryview(data)
        try:
            while self._unsent:
                self._unsent = self._unsent[self._connection.send(self._unsent) :]
                self._progress_s = time.monotonic()
        except BlockingIOError:
            self.is_stalled = time.monotonic() - self._progress_s > STALL_TIMEOUT_S
        except OSError:
            return False
        return not self.is_stalled

    def close(self) -> None:
        """Disconnect."""
        self._connection.close()

    def _is_connected(self) -> bool:
        """Discard what the client sends; False if it has disconnected."""
        try:
            for _ in range(16):
                if not self._connection.recv(65536):
                    return False
        except BlockingIOError:
            pass
        except OSError:
            return False
        return True
