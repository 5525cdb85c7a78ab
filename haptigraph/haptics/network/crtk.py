"""Vibrate a leader arm with the CRTK interface: a small force at its tip, over DDS without ROS.

The force swings along one axis and changes its sign, so that its mean is zero and it pushes the hand nowhere.
A thread publishes it; it is zero as soon as the device is silent, and by itself `HOLDS_MS` after the last
command. `run_device` runs this device in a watchdog process, which silences it when the run dies.
"""

import math
import threading
import time
from contextlib import suppress
from urllib.parse import parse_qsl

from haptigraph.errors import BadInput, DeviceError, unknown_name
from haptigraph.haptics.network.ros2 import DISCOVERY_S
from haptigraph.messages import Capabilities

__all__ = ["CrtkDevice", "Swing"]

RATE_HZ = 500.0
FREQUENCY_HZ = 20.0, RATE_HZ / 5
"""With fewer than five samples per period the force would be another than the pattern's."""
DEFAULT_HZ = 80.0
DEFAULT_N, LIMIT_N = 0.5, 2.0
HOLDS_MS = 150.0
ZEROS = 25  # wrenches of zero after a vibration, in case one is lost
COMMAND = "/servo_cf"


class Swing:
    """A force that swings about zero, and ends by itself.

    Args:
        newton: Its largest value, at full amplitude [N].
    """

    def __init__(self, newton: float) -> None:
        self._newton = newton
        self._amplitude, self._frequency_hz = 0.0, DEFAULT_HZ
        self._turns, self._at_s, self._until_s = 0.0, 0.0, 0.0

    def set(self, amplitude: float, frequency_hz: float, now_s: float) -> None:
        """Swing from now on; a frequency of 0 or beyond `FREQUENCY_HZ` becomes a possible one."""
        low_hz, high_hz = FREQUENCY_HZ
        self.force_n(now_s)  # up to here as before, so that the phase does not jump
        self._amplitude = min(max(amplitude, 0.0), 1.0) if math.isfinite(amplitude) else 0.0
        self._frequency_hz = min(max(frequency_hz, low_hz), high_hz) if frequency_hz > 0 else DEFAULT_HZ
        self._until_s = now_s + HOLDS_MS / 1e3

    @property
    def is_on(self) -> bool:
        """Whether it has not ended yet."""
        return self._amplitude > 0

    def force_n(self, now_s: float) -> float:
        """Return the force now [N]; its size never exceeds the largest value."""
        elapsed_s, self._at_s = now_s - self._at_s, now_s
        if not self._amplitude or now_s >= self._until_s:
            self._amplitude = self._turns = 0.0
            return 0.0
        self._turns = (self._turns + elapsed_s * self._frequency_hz) % 1.0
        return self._newton * self._amplitude * math.sin(2 * math.pi * self._turns)


class CrtkDevice:
    """Publish the force of one arm. Opening waits briefly for a subscriber.

    Args:
        argument: NAMESPACE, or NAMESPACE?newton=N with the largest force, at most `LIMIT_N`.

    Raises:
        BadInput: If the namespace or the force is not valid, or the network cannot be joined.
        MissingExtra: If cyclonedds is not installed.
    """

    capabilities = Capabilities(
        amplitude_levels=65535,
        frequency_range_hz=FREQUENCY_HZ,
        shortest_on_ms=20.0,
        max_rate_hz=None,
        holds_ms=HOLDS_MS,
        limitations="The arm must accept servo_cf; a pattern without frequency swings at 80 Hz.",
    )

    def __init__(self, argument: str = "") -> None:
        # Imported here, so that the capabilities are available without the extra.
        from haptigraph.ros2 import geometry_types, motion_types, types  # noqa: PLC0415
        from haptigraph.ros2.node import Node, checked_topic  # noqa: PLC0415

        self._types, self._geometry, self._motion = types, geometry_types, motion_types
        namespace, self._swing = _parsed(argument)
        self._topic = checked_topic(f"{namespace}{COMMAND}")
        self._node = Node()
        self._publisher = self._node.publisher(self._topic, motion_types.WrenchStamped)
        self._lock, self._problem = threading.Lock(), ""
        self._wakeup, self._closing = threading.Event(), False
        self._node.await_subscribers(DISCOVERY_S)
        self._send()  # zero: an earlier process may have left a force
        self._thread = threading.Thread(target=self._run, name="haptigraph-force", daemon=True)
        self._thread.start()

    @staticmethod
    def found() -> dict[str, str]:
        """Return the arms that accept a force: the device argument and the ROS domain of each."""
        from haptigraph.ros2.node import Node, domain_id  # noqa: PLC0415
        from haptigraph.ros2.topics import topics_found  # noqa: PLC0415

        topics = [topic for topic in topics_found(Node.subscribed) if topic.endswith(COMMAND)]
        arms = [topic.removesuffix(COMMAND).strip("/") for topic in topics]
        return {f"crtk:{arm}": f"accepts servo_cf on ROS domain {domain_id()}" for arm in arms}

    def set(self, amplitude: float, frequency_hz: float, stamp_ns: int) -> None:
        """Set the swing; silence is published at once.

        Raises:
            DeviceError: If no arm subscribes, or the force cannot be published.
        """
        with self._lock:
            self._swing.set(amplitude, frequency_hz, time.monotonic())
        self._send()
        self._wakeup.set()
        if not self._thread.is_alive():
            raise DeviceError(
                f"crtk:{self._topic}: no force is published any more ({self._problem or 'closed'})"
            )
        if not self._publisher.has_subscribers:
            raise DeviceError(f"no arm subscribes to {self._topic} (ROS domain {self._node.domain})")

    def close(self) -> None:
        """Publish a force of zero and leave the network.

        Raises:
            DeviceError: If it could not be published.
        """
        if self._closing:
            return
        with self._lock:
            self._swing.set(0.0, 0.0, time.monotonic())
        self._closing = True
        self._wakeup.set()
        self._thread.join()
        try:
            self._send()
        finally:
            self._node.close()

    def _run(self) -> None:
        """Publish while the arm vibrates, and some zeros afterwards."""
        zeros, due_s = 0, time.monotonic()
        pause = threading.Event()
        try:
            while not self._closing or zeros < ZEROS:
                if zeros >= ZEROS:
                    self._wakeup.wait()
                    zeros, due_s = 0, time.monotonic()
                self._wakeup.clear()
                zeros = 0 if self._send() else zeros + 1
                due_s = max(due_s + 1 / RATE_HZ, time.monotonic())
                pause.wait(due_s - time.monotonic())
        except DeviceError as error:
            self._problem = str(error)

    def _send(self) -> bool:
        """Publish the present force; return whether the arm vibrates."""
        header = self._types.Header(self._types.Time.from_ns(time.time_ns()))
        with self._lock:
            force = self._geometry.Vector3(self._swing.force_n(time.monotonic()))
            try:
                self._publisher.send(self._motion.WrenchStamped(header, self._motion.Wrench(force)))
            except OSError as error:
                raise DeviceError(f"{self._topic} cannot be published ({error})") from None
            return self._swing.is_on


def _parsed(argument: str) -> tuple[str, Swing]:
    namespace, _, query = argument.partition("?")
    if not namespace:
        raise BadInput("device crtk needs the arm's namespace, for example crtk:MTML/body")
    options = dict(parse_qsl(query, keep_blank_values=True))
    for name in options.keys() - {"newton"}:
        raise BadInput(unknown_name("option", name, ["newton"]), f"crtk:{argument}")
    newton = math.nan
    with suppress(ValueError):
        newton = float(options.get("newton", DEFAULT_N))
    if not 0 < newton <= LIMIT_N:
        raise BadInput(
            f"newton={options['newton']}: expected the largest force in N, above 0, at most {LIMIT_N:g}",
            f"crtk:{argument}",
        )
    return namespace, Swing(newton)
