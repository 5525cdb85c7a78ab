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
    """A client by Foxglove's published protocol (https://github.com/foxglove/ws-protocol)."""

    def __init__(self, socket):
        self.socket, self.channels = socket, {}
        while len(self.channels) < len(TOPICS):
            told = self.socket.recv(timeout=30)
            if isinstance(told, str) and (message := json.loads(told))["op"] == "advertise":
                self.channels |= {channel["topic"]: channel for channel in message["channels"]}
        subscriptions = [
            {"id": number, "channelId": self.channels[topic.name]["id"]}
            for number, topic in enumerate(TOPICS)
        ]
        self.socket.send(json.dumps({"op": "subscribe", "subscriptions": subscriptions}))

    def next(self):
        """Topic, log time [ns] and bytes of the next message."""
        while True:
            told = self.socket.recv(timeout=30)
            if isinstance(told, bytes) and told[0] == 1:
                number, log_ns = struct.unpack("<IQ", told[1:13])
                return TOPICS[number].name, log_ns, told[13:]


@contextmanager
def viewer_of(port):
    def is_served():
        with socket.socket() as probe:
            return probe.connect_ex(("127.0.0.1", port)) == 0

    until(is_served, "nobody serves")
    with connect(f"ws://127.0.0.1:{port}", subprotocols=["foxglove.sdk.v1"], max_size=None) as connection:
        yield Viewer(connection)


def say_nonsense(port):
    with viewer_of(port) as rude:
        for nonsense in ("{", '{"op": "subscribe"}', '{"op": "x"}', b"\xff" * 1000, b""):
            rude.socket.send(nonsense)


def test_a_viewer_sees_a_run_live_as_it_is_recorded_whatever_others_say(free_port, quick_uri, tmp_path):
    path = tmp_path / "run.mcap"
    run = running(quick_uri, "--bridge", f"foxglove:{free_port}", "--record", path)
    with run as process, viewer_of(free_port) as viewer:
        say_nonsense(free_port)
        seen = {}
        while len(seen) < 120:
            topic, log_ns, data = viewer.next()
            seen[topic, log_ns] = data
    with path.open("rb") as file:
        reader, recorded, schemas = make_reader(file), {}, {}
        for schema, channel, message in reader.iter_messages():
            recorded[channel.topic, message.log_time] = message.data
            schemas[channel.topic] = schema
    assert {topic for topic, _ in seen} >= {
        "/camera/image",
        "/capture",
        "/graph",
        "/state",
        "/command",
        "/timing",
    }
    for topic, log_ns in seen:
        assert seen[topic, log_ns] == recorded[topic, log_ns], topic
    for topic, schema in schemas.items():
        offered = viewer.channels[topic]
        assert (offered["schemaName"], offered["encoding"]) == (schema.name, "json")
        assert json.loads(offered["schema"]) == json.loads(schema.data)
    assert "! bridge" not in process.told
    assert "Traceback" not in process.told
