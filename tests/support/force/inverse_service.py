"""The simulation channel of the Haply Inverse service, as Haply documents it, without a device.

python inverse_service.py > ../../data/inverse3/conversation.jsonl    records what the device class says to it

https://docs.haply.co/inverseSDK/service/realtime/websocket-protocol: on connect an inventory of all devices,
then exactly one state for each message; `set_cursor_force` lasts until the next one.
"""

import json
import sys
import threading
import time
from contextlib import contextmanager, suppress

from websockets.exceptions import ConnectionClosed
from websockets.sync.server import serve

ID = "049D"
IDENTITY = {"w": 1.0, "x": 0.0, "y": 0.0, "z": 0.0}
ZERO = {"x": 0.0, "y": 0.0, "z": 0.0}
CONFIG = {
    "type": "inverse3",
    "port": "COM12",
    "device_info": {"major_version": 7, "minor_version": 4, "id": ID, "device_type": 4, "uuid": "0"},
    "gravity_compensation": {"enabled": True, "scaling_factor": 1.0},
    "handedness": "right",
    "preset": "defaults",
    "basis": {"permutation": "XYZ"},
    "filters": {"force_gate": {"gain": 0.3}, "damping": {"scalar": 0.0}},
}


def vector(xyz):
    return dict(zip("xyz", xyz, strict=True))


def approach(device, service):
    """A hand that presses the clutch and moves 2 mm into a wall; return its readings."""
    readings = [device.exchange((0.0, 0.0, 0.0))]
    if service is not None:
        service.buttons["a"] = True
    for number in range(5):
        if service is not None:
            service.position_m = (0.001 * number, -0.12 + 0.0005 * number, 0.15 - 0.002 * number)
            service.velocity_m_s = (0.01, 0.005, -0.02)
        readings.append(device.exchange((0.0, 0.25 * number, -0.125 * number)))
    device.close()
    return readings


class Recorded:
    """A service that can only say what was recorded, if it hears what was recorded."""

    def __init__(self, said):
        self.said, self.differences, self.address = said, [], ""

    def talk(self, socket):
        texts = iter(socket)
        with suppress(ConnectionClosed, StopIteration):
            for who, text in self.said:
                if who == "service":
                    socket.send(text)
                elif (heard := next(texts)) != text:
                    self.differences.append((text, heard))


class Service:
    """One service; its fields may be changed at any time, by the thread of a test."""

    def __init__(self):
        self.devices, self.is_wired = [ID], False
        self.position_m, self.velocity_m_s = (0.0, -0.12, 0.15), (0.0, 0.0, 0.0)
        self.buttons = {"a": False, "b": False, "c": False}
        self.has_grip = self.is_ready = self.is_calibrated = True
        self.is_silent = self.reports_no_force = False
        self.stuck_force = None
        self.delay_s = 0.0
        self.force = dict(ZERO)
        self.forces: list[tuple[int, tuple[float, float, float]]] = []
        """Every force that arrived, and when [monotonic ns]."""
        self.said: list[tuple[str, str]] = []
        """The conversation: who ("client" or "service"), and what."""
        self.address = ""
        self.sockets = []

    def drop(self):
        """Close all connections."""
        for socket in self.sockets:
            socket.close()

    def entry(self, device):
        force = self.stuck_force or self.force
        state = {
            "cursor_position": vector(self.position_m),
            "cursor_velocity": vector(self.velocity_m_s),
            "angular_position": {"a0": 0.0, "a1": 0.0, "a2": 0.0},
            "body_orientation": IDENTITY,
            "control_domain": "cartesian",
            "control_mode": "force",
        }
        if not self.reports_no_force:
            state["current_cursor_force"] = force
        status = {
            "calibrated": self.is_calibrated,
            "in_use": True,
            "power_supply": True,
            "ready": self.is_ready,
        }
        return {"device_id": device, "state": state, "status": status}

    def message(self, *, is_first=False):
        message = {"session_id": 7, "inverse3": [self.entry(device) for device in self.devices]}
        if self.has_grip and self.is_wired:
            state = {"button": self.buttons["a"], "hall": 0, "orientation": IDENTITY}
            message["verse_grip"] = [{"device_id": "61548", "state": state}]
        elif self.has_grip:
            state = {"buttons": dict(self.buttons), "battery_level": 0.9, "orientation": IDENTITY}
            message["wireless_verse_grip"] = [{"device_id": "61570", "state": state}]
        if is_first:
            for entry in message["inverse3"]:
                entry["config"] = CONFIG
        return json.dumps(message)

    def talk(self, socket):
        self.sockets.append(socket)
        with suppress(ConnectionClosed):
            self.send(socket, self.message(is_first=True))
            for text in socket:
                text = text if isinstance(text, str) else text.decode()
                self.said.append(("client", text))
                self.take(json.loads(text))
                if not self.is_silent:
                    time.sleep(self.delay_s)
                    self.send(socket, self.message())

    def send(self, socket, text):
        self.said.append(("service", text))
        socket.send(text)

    def take(self, command):
        for entry in command.get("inverse3", []):
            values = entry.get("commands", {}).get("set_cursor_force", {}).get("values")
            if values is not None:
                self.force = values
                self.forces.append((time.monotonic_ns(), (values["x"], values["y"], values["z"])))


@contextmanager
def serving(service):
    """Serve on a free port of this machine; close all connections at the end."""
    with serve(service.talk, "127.0.0.1", 0, compression=None, close_timeout=0.5) as server:
        host, port = server.socket.getsockname()[:2]
        service.address = f"{host}:{port}"
        thread = threading.Thread(target=server.serve_forever, daemon=True)
        thread.start()
        try:
            yield service
        finally:
            server.shutdown()
            thread.join()


def main():
    from haptigraph.clock import MonotonicClock
    from haptigraph.haptics.force.devices.inverse3 import Inverse3

    with serving(Service()) as service:
        approach(Inverse3(service.address, MonotonicClock()), service)
    for who, text in service.said:
        sys.stdout.write(json.dumps({"who": who, "text": text}) + "\n")


if __name__ == "__main__":
    main()
