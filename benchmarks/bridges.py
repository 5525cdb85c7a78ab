"""Latency of the bridges, and delay until a device at the end of a network is silent. Needs the extras.

    python benchmarks/bridges.py

Every figure is the time from an image (for silence: the last image) to its receipt in another process on this
machine, including perception and rules.
"""

import json
import os
import socket
import struct
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "support"))

import pylsl
from ros_network import Peer, loopback, running, tag, until
from websockets.sync.client import connect

from haptigraph.recording.codec import encode_jpeg
from haptigraph.ros2.types import CompressedImage, Header, JoyFeedback, PointStamped, Time
from haptigraph.sources.phantom import PhantomSource

COUNT = 300
SCENARIO = "phantom:misaligned_then_correct"
STOPS = 20


def print_latency(name: str, latency_ms: list[float]) -> None:
    """Print percentiles of a latency."""
    p50, p99 = np.percentile(latency_ms, [50, 99])
    print(f"{name:44} {len(latency_ms):4}   p50 {p50:6.1f} ms   p99 {p99:6.1f} ms", flush=True)


def ros2(peer: Peer) -> list[float]:
    """Subscribe to the needle's tip in ROS 2."""
    peer.subscribe("/haptigraph/needle_tip", PointStamped)
    peer.next("/haptigraph/needle_tip")
    latency_ms = []
    for _ in range(COUNT):
        stamp_ns = peer.next("/haptigraph/needle_tip").header.stamp.ns
        latency_ms.append((time.time_ns() - stamp_ns) / 1e6)
    return latency_ms


def lsl() -> list[float]:
    """Pull the measures from an LSL inlet."""
    inlet = pylsl.StreamInlet(pylsl.resolve_byprop("name", "haptigraph.measures", timeout=30)[0])
    inlet.pull_sample(timeout=30)
    latency_ms = []
    for _ in range(COUNT):
        _, stamp_s = inlet.pull_sample(timeout=30)
        latency_ms.append((pylsl.local_clock() - stamp_s) * 1e3)
    return latency_ms


def openigtlink(port: int) -> list[float]:
    """Read the messages of an OpenIGTLink client."""
    latency_ms = []
    with socket.create_connection(("127.0.0.1", port)) as client:
        while len(latency_ms) < COUNT:
            _, _, _, stamp, size, _ = struct.unpack(">H12s20sQQQ", client.recv(58, socket.MSG_WAITALL))
            client.recv(size, socket.MSG_WAITALL)
            latency_ms.append((time.time() - stamp / 2**32) * 1e3)
    return latency_ms


def foxglove(port: int, topic: str) -> list[float]:
    """Subscribe to a channel like a Foxglove viewer."""
    latency_ms, channels = [], {}
    with connect(f"ws://127.0.0.1:{port}", subprotocols=["foxglove.sdk.v1"], max_size=None) as viewer:
        while topic not in channels:
            message = json.loads(viewer.recv(timeout=30))
            channels |= {channel["topic"]: channel["id"] for channel in message.get("channels", ())}
        viewer.send(
            json.dumps({"op": "subscribe", "subscriptions": [{"id": 1, "channelId": channels[topic]}]})
        )
        while len(latency_ms) < COUNT:
            data = viewer.recv(timeout=30)
            if isinstance(data, bytes):
                latency_ms.append((time.time_ns() - struct.unpack("<Q", data[5:13])[0]) / 1e6)
    return latency_ms


def silence(peer: Peer) -> list[float]:
    """Measure the time from the last image until the subscriber receives 0, when a camera stops."""
    source, latency_ms = PhantomSource("misaligned_then_correct"), []
    images = [source.read(1.0).image for _ in range(90)]
    data = encode_jpeg(images[-1], 90)
    eye = Path(tempfile.mkdtemp()) / "eye.toml"
    eye.write_text(source.registration)
    device = ("--device", "ros2", "--bridge", "ros2")
    with running("ros2:/camera/image", "--registration", eye, *device):
        peer.subscribe("/joy/set_feedback", JoyFeedback)
        say = peer.publisher("/camera/image", CompressedImage)
        until(lambda: "/joy/set_feedback" in peer.node.published(), "the run does not start")
        for _ in range(STOPS):
            amplitude = 0.0
            while amplitude == 0.0:
                last_s = time.perf_counter()
                say.send(CompressedImage(Header(Time.from_ns(time.time_ns())), "jpeg", data))
                time.sleep(0.033)
                while not peer.received["/joy/set_feedback"].empty():
                    amplitude = peer.received["/joy/set_feedback"].get().intensity
            while amplitude > 0.0:
                amplitude = peer.received["/joy/set_feedback"].get(timeout=5).intensity
            latency_ms.append((time.perf_counter() - last_s) * 1e3)
    return latency_ms


def main() -> None:
    """Measure all bridges, one after the other."""
    os.environ.update(loopback(tag()))
    peer = Peer()
    print_latency("silence at a ROS 2 subscriber, images stop", silence(peer))
    bridges = ("ros2", "lsl", "openigtlink:18955", "foxglove:8765")
    for bridge in bridges:
        with running(SCENARIO, "--set", "source.loop=true", "--bridge", bridge):
            if bridge == "ros2":
                print_latency("ros2: needle_tip", ros2(peer))
            elif bridge == "lsl":
                print_latency("lsl: measures", lsl())
            else:
                port = int(bridge.partition(":")[2])
                until(lambda port=port: not socket.socket().connect_ex(("127.0.0.1", port)), "no server")
                if bridge.startswith("openigtlink"):
                    print_latency("openigtlink: state and needle", openigtlink(port))
                else:
                    print_latency("foxglove: /state", foxglove(port, "/state"))
                    print_latency("foxglove: /camera/image", foxglove(port, "/camera/image"))
    peer.node.close()


if __name__ == "__main__":
    main()
