"""A Haply Inverse3, over the WebSocket of the Haply Inverse service.

The messages are those that Haply documents for version 3.1 of its JSON format, port 10001
(https://docs.haply.co/inverseSDK/service): the service answers each command with one state of all devices.
The clutch is a button of the VerseGrip. Haply's axes are x right, y forward, z up, in metres and newtons.
"""

from collections import deque
from urllib.parse import parse_qsl

import msgspec

from haptigraph.clock import Clock
from haptigraph.errors import BadInput, DeviceError, unknown_name
from haptigraph.haptics.force.devices.inverse3_messages import GripState, InverseEntry, ServiceMessage, Triple
from haptigraph.haptics.force.devices.web_socket import WebSocket
from haptigraph.haptics.force.interface import ForceCapabilities, HandReading
from haptigraph.robot.pose import Vec3

__all__ = ["Inverse3"]

DEFAULT = "localhost:10001"
OPTIONS = {"device": "", "button": "a"}
BUTTONS = ("a", "b", "c")
CONNECT_S, FOUND_S = 2.0, 0.2
REPLY_NS = 5_000_000
LOST_NS = 100_000_000
"""Without a state for this time the service counts as lost."""
MAX_LATE = 20
"""Exchanges in a row that end with commands unanswered: an answer was lost, or the service is too slow."""
CONFIRMS = 40  # exchanges in which the service must report that its force is zero
LIMIT_N, LIMIT_MM_S = 3.0, 250.0
DELAY_MS = 2.0  # assumed: Haply does not document it
RELEASED_N = 0.01
ZERO: Vec3 = (0.0, 0.0, 0.0)
SESSION = {"configure": {"profile": {"name": "haptigraph"}, "basis": {"permutation": "XYZ"}}}


class Inverse3:
    """Push the hand at one Inverse3.

    Args:
        argument: [HOST:PORT][?device=ID&button=a|b|c]: the service, the device if there are several, and the
            button of a wireless VerseGrip that is the clutch.
        clock: Stamps the readings.

    Raises:
        BadInput: If the service cannot be reached, or has no such device, or no VerseGrip.
    """

    capabilities = ForceCapabilities(
        max_force_n=LIMIT_N,
        rate_hz=1000.0,
        max_speed_mm_s=LIMIT_MM_S,
        delay_ms=DELAY_MS,
        limitations="Never tried on hardware. The clutch is a button of the VerseGrip.",
    )

    def __init__(self, argument: str, clock: Clock) -> None:
        self._clock, self._argument = clock, argument
        address, self._options = _parsed(argument)
        self._decode = msgspec.json.Decoder(ServiceMessage).decode
        self._is_closed = self._is_lost = False
        self._late = 0
        self._force: Triple | None = None
        self._socket = _connected(address, CONNECT_S)
        try:
            self._id = self._chosen(self._first())
            self._sent_ns = deque[int]()
            """When the commands were sent that are not answered yet."""
            self._heard_ns = clock.now_ns()
            self._reading = HandReading(self._heard_ns, ZERO, ZERO, False)
            self._send(ZERO, {"session": SESSION})
        except BaseException:
            self._socket.close()
            raise

    @staticmethod
    def found() -> dict[str, str]:
        """Return the devices of the service on this machine: the argument of each, and what it is."""
        try:
            connection = _connected(DEFAULT, FOUND_S)
        except BadInput:
            return {}
        try:
            texts = connection.receive(FOUND_S)
            entries = msgspec.json.decode(texts[0], type=ServiceMessage).inverse3 if texts else []
        except (OSError, msgspec.MsgspecError):
            return {}
        finally:
            connection.close()
        return {f"inverse3:{DEFAULT}?device={each.device_id}": "Haply Inverse3" for each in entries}

    def exchange(self, force_n: Vec3) -> HandReading:
        """Send a force, and return the newest state; the one before, if the answer takes too long.

        Raises:
            DeviceError: If the service is lost, or has lost the device.
        """
        self._send(force_n)
        give_up_ns = self._clock.now_ns() + REPLY_NS
        while self._sent_ns and (left_ns := give_up_ns - self._clock.now_ns()) > 0:
            self._take_states(left_ns / 1e9)
        self._late = self._late + 1 if self._sent_ns else 0
        if self._late > MAX_LATE or self._clock.now_ns() - self._heard_ns > LOST_NS:
            self._is_lost = True
            raise DeviceError("the Inverse service does not answer in time")
        return self._reading

    def close(self) -> None:
        """Send a force of zero, await its confirmation, and disconnect.

        Raises:
            DeviceError: If the service did not confirm it.
        """
        if self._is_closed:
            return
        self._is_closed = True
        try:
            if not self._is_lost and self._confirms():
                return
            raise DeviceError("the Inverse service did not confirm that the force is zero")
        finally:
            self._socket.close()

    def _confirms(self) -> bool:
        """Return whether the service answers a force of zero, and reports none, where it reports any."""
        for _ in range(CONFIRMS):
            self.exchange(ZERO)
            force = self._force
            is_zero = force is None or max(abs(force.x), abs(force.y), abs(force.z)) < RELEASED_N
            if not self._sent_ns and is_zero:
                return True
        return False

    def _send(self, force_n: Vec3, more: dict[str, object] | None = None) -> None:
        x, y, z = force_n
        values = {"x": x, "y": 0.0 - z, "z": y}
        command = {"device_id": self._id, "commands": {"set_cursor_force": {"values": values}}}
        self._sent_ns.append(self._clock.now_ns())
        try:
            self._socket.send(msgspec.json.encode({**(more or {}), "inverse3": [command]}))
        except OSError as error:
            self._is_lost = True
            raise DeviceError(f"the Inverse service is lost ({error})") from None

    def _take_states(self, within_s: float) -> None:
        """Take the states that answer commands, in the order in which these were sent."""
        try:
            messages = [self._decode(text) for text in self._socket.receive(within_s)]
        except OSError as error:
            self._is_lost = True
            raise DeviceError(f"the Inverse service is lost ({error})") from None
        except msgspec.MsgspecError as error:
            raise DeviceError(f"the Inverse service sent an invalid message ({error})") from None
        for message in messages:
            sent_ns = self._sent_ns.popleft() if self._sent_ns else self._clock.now_ns()
            for entry in message.inverse3:
                if entry.device_id == self._id:
                    is_engaged = any(self._is_held(grip.state) for grip in message.grips)
                    self._take_state(entry, is_engaged and entry.status.ready, sent_ns)

    def _take_state(self, entry: InverseEntry, is_engaged: bool, sent_ns: int) -> None:
        """Take a state, which was measured after its command was sent."""
        state, self._heard_ns = entry.state, self._clock.now_ns()
        position_mm, velocity_mm_s = _ours_mm(state.cursor_position), _ours_mm(state.cursor_velocity)
        self._reading = HandReading(sent_ns, position_mm, velocity_mm_s, is_engaged)
        self._force = state.current_cursor_force

    def _is_held(self, grip: GripState) -> bool:
        return grip.button or grip.buttons.get(self._options["button"], False)

    def _first(self) -> ServiceMessage:
        """Return the list of all devices, which the service sends first."""
        try:
            texts = self._socket.receive(CONNECT_S)
            return self._decode(texts[0])
        except (OSError, IndexError, msgspec.MsgspecError) as error:
            raise BadInput(
                f"the Inverse service does not list its devices as it should ({error})", self._name
            ) from None

    def _chosen(self, message: ServiceMessage) -> str:
        """Return the device to push."""
        known = {entry.device_id: entry for entry in message.inverse3}
        wanted = self._options["device"]
        if not known:
            raise BadInput("the Inverse service has no Inverse3; connect one", self._name)
        if wanted and wanted not in known:
            raise BadInput(unknown_name("device", wanted, known), self._name)
        if not wanted and len(known) > 1:
            raise BadInput(f"there are several; choose one: ?device={' or ?device='.join(known)}", self._name)
        entry = known[wanted] if wanted else message.inverse3[0]
        if not entry.status.calibrated:
            raise BadInput(f"{entry.device_id} is not calibrated; calibrate it in Haply Hub", self._name)
        if not message.grips:
            raise BadInput("there is no VerseGrip, whose button is the clutch; connect one", self._name)
        return entry.device_id

    @property
    def _name(self) -> str:
        return f"inverse3:{self._argument}"


def _connected(address: str, within_s: float) -> WebSocket:
    host, _, port = address.rpartition(":")
    if not host or not port.isdecimal() or not 0 < int(port) < 65536:
        raise BadInput(f"found {address!r}; expected HOST:PORT, for example {DEFAULT}", "inverse3")
    try:
        return WebSocket(host, int(port), within_s)
    except OSError as error:
        raise BadInput(
            f"the Haply Inverse service cannot be reached at {address} ({error}); start it, or Haply Hub",
            "inverse3",
        ) from None


def _parsed(argument: str) -> tuple[str, dict[str, str]]:
    address, _, query = argument.partition("?")
    given = dict(parse_qsl(query, keep_blank_values=True))
    for name in given.keys() - OPTIONS.keys():
        raise BadInput(unknown_name("option", name, OPTIONS), f"inverse3:{argument}")
    options = {**OPTIONS, **given}
    if options["button"] not in BUTTONS:
        raise BadInput(unknown_name("button", options["button"], BUTTONS), f"inverse3:{argument}")
    return address or DEFAULT, options


def _ours_mm(haply: Triple) -> Vec3:
    """Return a vector [mm] in our axes: x right, y up, z towards the operator."""
    return 1e3 * haply.x, 1e3 * haply.z, 0.0 - 1e3 * haply.y
