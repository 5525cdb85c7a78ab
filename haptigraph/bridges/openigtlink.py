"""Serve needle and state over OpenIGTLink, so that 3D Slicer follows live.

Frame: RAS millimetres, Slicer's own. The eye frame becomes R = x (the surgeon at the head of a supine patient
has the patient's right on the right), A = y (from the retina to the front), S = z (out of the picture).
"""

import math
import socket
import time
from collections.abc import Iterable

from haptigraph.bridges.address import listening_at
from haptigraph.bridges.bridge import Run
from haptigraph.bridges.igtl_messages import Matrix, string, transform
from haptigraph.errors import BadInput
from haptigraph.geometry import Geometry, Point, Segment
from haptigraph.messages import Capture, Step

__all__ = ["OpenIgtLink", "needle_matrix"]

PORT = 18944
NEEDLE, STATE = "NeedleToEye", "SurgicalState"
STALLED_S = 5.0
MOST_CLIENTS = 8


class OpenIgtLink:
    """A server that any number of Slicers may connect to; a slow one misses steps, a stuck one is let go.

    Args:
        argument: PORT or HOST:PORT; 18944 on this machine if empty.
        run: What is told.

    Raises:
        BadInput: If it cannot listen there.
    """

    def __init__(self, argument: str, run: Run) -> None:
        self._utc_offset_ns = run.info.utc_offset_ns
        host, port = listening_at(argument, "openigtlink", PORT)
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

    def send(self, capture: Capture, step: Step) -> None:
        """Tell every client the state, and where the needle is if there is one."""
        self._welcome()
        if not self._clients:
            return
        utc_ns = step.stamp_ns + self._utc_offset_ns
        data = string(STATE, utc_ns, step.conclusion.state)
        found = step.observation.found
        line = found.get("needle_line")
        if isinstance(line, Segment):
            data += transform(NEEDLE, utc_ns, needle_matrix(line, found.get("needle_tip")))
        self._keep(client for client in self._clients if client.tell(data))

    def felt(self, stamp_ns: int, amplitude: float, frequency_hz: float) -> None:
        """Do nothing: Slicer has no use for it."""

    def take_problems(self) -> tuple[str, ...]:
        """Return which clients were let go because they took nothing any more."""
        problems, self._problems = tuple(self._problems), []
        return problems

    def close(self) -> None:
        """Hang up."""
        self._keep(())
        self._listener.close()

    def _welcome(self) -> None:
        while len(self._clients) < MOST_CLIENTS:
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
                    self._problems.append(f"a client took nothing for {STALLED_S:g} s and was let go")
        self._clients = kept


class _Client:
    """One connection: never waited for, and never left in the middle of a message."""

    def __init__(self, connection: socket.socket) -> None:
        connection.setblocking(False)
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._connection = connection
        self._unsent = memoryview(b"")
        self._moved_s = time.monotonic()
        self.is_stalled = False

    def tell(self, data: bytes) -> bool:
        """Send data, unless older data is still on its way; return whether the client is still there."""
        if not self._is_there():
            return False
        if not self._unsent:
            self._unsent = memoryview(data)
        try:
            while self._unsent:
                self._unsent = self._unsent[self._connection.send(self._unsent) :]
                self._moved_s = time.monotonic()
        except BlockingIOError:
            self.is_stalled = time.monotonic() - self._moved_s > STALLED_S
        except OSError:
            return False
        return not self.is_stalled

    def close(self) -> None:
        """Hang up."""
        self._connection.close()

    def _is_there(self) -> bool:
        """Throw away what the client says, whatever it is; False if it has hung up."""
        try:
            for _ in range(16):
                if not self._connection.recv(65536):
                    return False
        except BlockingIOError:
            pass
        except OSError:
            return False
        return True


def needle_matrix(line: Segment, tip: Geometry | None = None) -> Matrix:
    """Return where the needle is: origin in its tip, z along the shaft towards the tip, as SlicerIGT's model.

    Args:
        line: The visible shaft; eye frame.
        tip: Its tip, where that is not the line's end: a bevel's lies beside it.
    """
    (x0, y0), (x1, y1) = line.start_mm, line.end_mm
    length_mm = math.hypot(x1 - x0, y1 - y0)
    if length_mm == 0:
        x, y = 0.0, -1.0
    else:
        x, y = (x1 - x0) / length_mm, (y1 - y0) / length_mm
    at_x, at_y = tip.at_mm if isinstance(tip, Point) else line.end_mm
    return (y, 0.0, x, at_x), (-x, 0.0, y, at_y), (0.0, -1.0, 0.0, 0.0)
