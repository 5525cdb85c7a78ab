import json
import socket
import struct
from contextlib import contextmanager

import pytest
from mcap.reader import make_reader
from ros_network import running, until

from haptigraph.recording.schema import TOPICS

pytest.importorskip("foxglove")
from websockets.sync.client import connect

pytestmark = pytest.mark.timeout(180)


class Viewer:
    """A client of Foxglove's published protocol (https://github.com/foxglove/ws-protocol)."""

    def __init__(self, socket):
        self.socket, self.channels = socket, {}
        while len(self.channels) < len(TOPICS):
            data = self.socket.recv(timeout=30)
            if isinstance(data, str) and (message := json.loads(data))["op"] == "advertise":
                self.channels |= {channel["topic"]: channel for channel in message["channels"]}
        subscriptions = [
            {"id": number, "channelId": self.channels[topic.name]["id"]}
            for number, topic in enumerate(TOPICS)
        ]
        self.socket.send(json.dumps({"op": "subscribe", "subscriptions": subscriptions}))

    def next(self):
        """Topic, log time [ns] and bytes of the next message."""
        while True:
            data = self.socket.recv(timeout=30)
            if isinstance(data, bytes) and data[0] == 1:
                number, log_ns = struct.unpack("<IQ", data[1:13])
                return TOPICS[number].name, log_ns, data[13:]


@contextmanager
def viewer_of(port):
    def is_served():
        with socket.socket() as probe:
            return probe.connect_ex(("127.0.0.1", port)) == 0

    until(is_served, "no server")
    with connect(f"ws://127.0.0.1:{port}", subprotocols=["foxglove.sdk.v1"], max_size=None) as connection:
        yield Viewer(connection)


def send_invalid(port):
    with viewer_of(port) as invalid:
        for data in ("{", '{"op": "subscribe"}', '{"op": "x"}', b"\xff" * 1000, b""):
            invalid.socket.send(data)


def test_a_viewer_receives_the_recorded_messages_live_despite_invalid_clients(free_port, quick_uri, tmp_path):
    path = tmp_path / "run.mcap"
    run = running(quick_uri, "--bridge", f"foxglove:{free_port}", "--record", path)
    with run as process, viewer_of(free_port) as viewer:
        send_invalid(free_port)
        received = {}
        while len(received) < 120:
            topic, log_ns, data = viewer.next()
            received[topic, log_ns] = data
    with path.open("rb") as file:
        reader, recorded, schemas = make_reader(file), {}, {}
        for schema, channel, message in reader.iter_messages():
            recorded[channel.topic, message.log_time] = message.data
            schemas[channel.topic] = schema
    assert {topic for topic, _ in received} >= {
        "/camera/image",
        "/capture",
        "/graph",
        "/state",
        "/command",
        "/timing",
    }
    for topic, log_ns in received:
        assert received[topic, log_ns] == recorded[topic, log_ns], topic
    for topic, schema in schemas.items():
        channel = viewer.channels[topic]
        assert (channel["schemaName"], channel["encoding"]) == (schema.name, "json")
        assert json.loads(channel["schema"]) == json.loads(schema.data)
    assert "! bridge" not in process.output
    assert "Traceback" not in process.output
