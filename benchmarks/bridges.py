"""How late others learn, and how soon a hand at the other end of a network is still. Needs the extras.

    python benchmarks/bridges.py

Every figure is from the moment of the image (for silence: of the last one) until another process on this
machine has it: perception and rules are in it.
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


def told(name: str, late_ms: list[float]) -> None:
    """Print how late something was."""
    p50, p99 = np.percentile(late_ms, [50, 99])
    print(f"{name:44} {len(late_ms):4}   p50 {p50:6.1f} ms   p99 {p99:6.1f} ms", flush=True)


def ros2(peer: Peer) -> list[float]:
    """Follow the needle's tip as a ROS 2 subscriber."""
    peer.hear("/haptigraph/needle_tip", PointStamped)
    peer.next("/haptigraph/needle_tip")
    late_ms = []
    for _ in range(COUNT):
        stamp_ns = peer.next("/haptigraph/needle_tip").header.stamp.ns
        late_ms.append((time.time_ns() - stamp_ns) / 1e6)
    return late_ms


def lsl() -> list[float]:
    """Pull the measures through an inlet."""
    inlet = pylsl.StreamInlet(pylsl.resolve_byprop("name", "haptigraph.measures", timeout=30)[0])
    inlet.pull_sample(timeout=30)
    late_ms = []
    for _ in range(COUNT):
        _, stamp_s = inlet.pull_sample(timeout=30)
        late_ms.append((pylsl.local_clock() - stamp_s) * 1e3)
    return late_ms


def openigtlink(port: int) -> list[float]:
    """Read whatever a client of OpenIGTLink gets."""
    late_ms = []
    with socket.create_connection(("127.0.0.1", port)) as client:
        while len(late_ms) < COUNT:
            _, _, _, stamp, size, _ = struct.unpack(">H12s20sQQQ", client.recv(58, socket.MSG_WAITALL))
            client.recv(size, socket.MSG_WAITALL)
            late_ms.append((time.time() - stamp / 2**32) * 1e3)
    return late_ms


def foxglove(port: int, topic: str) -> list[float]:
    """Subscribe to a channel as a Foxglove viewer does."""
    late_ms, channels = [], {}
    with connect(f"ws://127.0.0.1:{port}", subprotocols=["foxglove.sdk.v1"], max_size=None) as viewer:
        while topic not in channels:
            message = json.loads(viewer.recv(timeout=30))
            channels |= {channel["topic"]: channel["id"] for channel in message.get("channels", ())}
        viewer.send(
            json.dumps({"op": "subscribe", "subscriptions": [{"id": 1, "channelId": channels[topic]}]})
        )
        while len(late_ms) < COUNT:
            data = viewer.recv(timeout=30)
            if isinstance(data, bytes):
                late_ms.append((time.time_ns() - struct.unpack("<Q", data[5:13])[0]) / 1e6)
    return late_ms


def silence(peer: Peer) -> list[float]:
    """From the last image until the subscriber hears 0, when a camera falls silent during a vibration."""
    source, late_ms = PhantomSource("misaligned_then_correct"), []
    images = [source.read(1.0).image for _ in range(90)]
    data = encode_jpeg(images[-1], 90)
    eye = Path(tempfile.mkdtemp()) / "eye.toml"
    eye.write_text(source.registration)
    device = ("--device", "ros2", "--bridge", "ros2")
    with running("ros2:/camera/image", "--registration", eye, *device):
        peer.hear("/joy/set_feedback", JoyFeedback)
        say = peer.say("/camera/image", CompressedImage)
        until(lambda: "/joy/set_feedback" in peer.node.published(), "the run does not start")
        for _ in range(STOPS):
            felt = 0.0
            while felt == 0.0:
                last_s = time.perf_counter()
                say.send(CompressedImage(Header(Time.from_ns(time.time_ns())), "jpeg", data))
                time.sleep(0.033)
                while not peer.heard["/joy/set_feedback"].empty():
                    felt = peer.heard["/joy/set_feedback"].get().intensity
            while felt > 0.0:
                felt = peer.heard["/joy/set_feedback"].get(timeout=5).intensity
            late_ms.append((time.perf_counter() - last_s) * 1e3)
    return late_ms


def main() -> None:
    """Measure all, one after the other."""
    os.environ.update(loopback(tag()))
    peer = Peer()
    told("silence at a ROS 2 subscriber, images stop", silence(peer))
    bridges = ("ros2", "lsl", "openigtlink:18955", "foxglove:8765")
    for bridge in bridges:
        with running(SCENARIO, "--set", "source.loop=true", "--bridge", bridge):
            if bridge == "ros2":
                told("ros2: needle_tip", ros2(peer))
            elif bridge == "lsl":
                told("lsl: measures", lsl())
            else:
                port = int(bridge.partition(":")[2])
                until(lambda port=port: not socket.socket().connect_ex(("127.0.0.1", port)), "nobody serves")
                if bridge.startswith("openigtlink"):
                    told("openigtlink: state and needle", openigtlink(port))
                else:
                    told("foxglove: /state", foxglove(port, "/state"))
                    told("foxglove: /camera/image", foxglove(port, "/camera/image"))
    peer.node.close()


if __name__ == "__main__":
    main()
