"""Interoperability with real ROS 2 nodes (Jazzy and Kilted, rclpy); set up by `make interop`."""

import json
import queue
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path

import msgspec
import numpy as np
import pytest
from ros_network import Peer, rclpy_environment, running

pytest.importorskip("cyclonedds")

from haptigraph.clock import MonotonicClock
from haptigraph.errors import SourceLost
from haptigraph.graph import SceneGraph
from haptigraph.inference.meaning import PAPER_KINDS
from haptigraph.recording.codec import encode_jpeg
from haptigraph.ros2.node import buffer_hint
from haptigraph.ros2.types import Joy, JoyFeedback
from haptigraph.sources.cameras.ros2 import Ros2Source
from haptigraph.sources.phantom import PhantomSource

HERE = Path(__file__).parent
COUNT, RAW_COUNT = 1000, 300
pytestmark = [pytest.mark.slow, pytest.mark.timeout(600)]


@pytest.fixture(scope="module")
def ros(distribution):
    """Start a real node in a role; it prints its result when it ends."""
    name, python = distribution
    started = []

    def start(*arguments):
        script = (python, HERE / "ros_node.py", *map(str, arguments))
        started.append(subprocess.Popen(script, stdout=subprocess.PIPE, text=True, env=rclpy_environment()))
        return started[-1]

    start.name = name
    yield start
    for process in started:
        process.kill()
        process.communicate()


def result_of(node):
    output, _ = node.communicate(timeout=300)
    assert node.returncode == 0, output
    return json.loads(output.splitlines()[-1])


@pytest.fixture(scope="module")
def eye(tmp_path_factory):
    """A registration, and images of a needle inside the eye."""
    folder = tmp_path_factory.mktemp("eye")
    source = PhantomSource("align_then_approach")
    (folder / "eye.toml").write_text(source.registration)
    for number in range(150):
        image = source.read(1.0).image
        if number >= 120:
            (folder / f"{number}.jpg").write_bytes(encode_jpeg(image, 80))
    return folder


def report(capsys, name, round_trips_ms):
    p50, p99 = np.percentile(round_trips_ms, [50, 99])
    with capsys.disabled():
        sys.stdout.write(f"\n{name}: {len(round_trips_ms)} of {COUNT}, p50 {p50:.2f} ms, p99 {p99:.2f} ms\n")


def test_a_ros_node_sends_images_and_receives_every_topic(ros, eye, capsys):
    arguments = ("ros2:/camera/image/compressed", "--registration", eye / "eye.toml")
    with running(*arguments, "--bridge", "ros2", "--device", "ros2") as process:
        received = result_of(ros("camera", eye, COUNT))
    assert len(received["round_trips_ms"]) == COUNT, process.output
    report(capsys, f"{ros.name}: image to needle tip", received["round_trips_ms"])
    assert received["frame_id"] == "haptigraph_eye"
    assert all(abs(place) < 0.013 for place in received["tip_m"])
    assert "needle_tip" in {node.id for node in msgspec.json.decode(received["graph"], type=SceneGraph).nodes}
    for topic in ("state", "graph", "theta", "needle_tip", "needle"):  # with the stamp of each image
        assert received["paired"][f"/haptigraph/{topic}"] == COUNT, topic
    assert sum(each**2 for each in received["quaternion"]) == pytest.approx(1.0)
    assert 0 < received["covariance"][0] < 0.0002**2
    assert len(received["covariance"]) == 36
    assert received["theta"] == [["theta"], 1]
    assert received["touch"] == [["touch"], 1]
    assert received["state"] in PAPER_KINDS
    assert received["counts"]["/haptigraph/touch"] > 0
    assert received["counts"]["/joy/set_feedback"] > 0
    assert received["counts"]["/diagnostics"] > 0
    assert received["level"] in (0, 1)
    assert received["types"]["/haptigraph/needle_tip"] == ["geometry_msgs/msg/PointStamped"]
    pose_type = ["geometry_msgs/msg/PoseWithCovarianceStamped"]
    assert received["types"]["/haptigraph/needle"] == pose_type
    assert received["types"]["/haptigraph/theta"] == ["sensor_msgs/msg/JointState"]
    assert received["types"]["/haptigraph/state"] == ["diagnostic_msgs/msg/DiagnosticArray"]
    assert received["types"]["/diagnostics"] == ["diagnostic_msgs/msg/DiagnosticArray"]


@pytest.mark.parametrize("size_px", [(1280, 720), (1920, 1080)])
def test_raw_images_of_a_ros_node_arrive(ros, size_px, capsys):
    """At least 99 %; the first may come before the subscriber has adapted to the publisher."""
    source = Ros2Source("/camera/image_raw", size_px=size_px, rate_hz=30.0, clock=MonotonicClock())
    node, ages_ms = ros("raw", *size_px, RAW_COUNT), []
    last = -1
    while node.poll() is None:
        with suppress(SourceLost):
            if (capture := source.read(0.1)) is not None:
                last = capture.index
                ages_ms.append((capture.camera.arrived_ns - capture.stamp_ns) / 1e6)
    source.close()
    p50, p99 = np.percentile(ages_ms, [50, 99])
    with capsys.disabled():
        size = "{} x {}".format(*size_px)
        sys.stdout.write(
            f"\n{ros.name}: raw {size}: {last + 1} of {RAW_COUNT}, p50 {p50:.1f} ms, p99 {p99:.1f} ms\n"
        )
    assert last + 1 >= 0.99 * RAW_COUNT, buffer_hint()


def test_a_ros_joystick_steers_without_losing_messages(ros):
    peer = Peer()
    peer.subscribe("/joy", Joy)
    with running("teleop:tests/data/steered.toml", "--bridge", "ros2"):
        moved_mm = result_of(ros("stick", COUNT))["moved_mm"]
    messages = [peer.received["/joy"].get(timeout=1.0) for _ in range(COUNT)]
    peer.node.close()
    assert [joy.header.stamp.sec for joy in messages] == list(range(COUNT))
    assert (list(messages[0].axes), list(messages[0].buttons)) == ([0.0, 1.0, 0.5], [0, 0, 0, 0, 0, 1])
    assert moved_mm > 2


def test_joy_feedback_is_exchanged_with_a_ros_node(ros, capsys):
    node, peer = ros("echo"), Peer()
    peer.subscribe("/back", JoyFeedback)
    forth = peer.publisher("/forth", JoyFeedback)
    for _ in range(100):  # until discovery is complete; not counted
        forth.send(JoyFeedback(1, 0, -1.0))
        try:
            peer.received["/back"].get(timeout=0.2)
            break
        except queue.Empty:
            continue
    round_trips_ms = []
    for number in range(COUNT):
        intensity, sent_s = number / COUNT, time.perf_counter()
        forth.send(JoyFeedback(1, 0, intensity))
        peer.next("/back", lambda message, sent=intensity: message.intensity == pytest.approx(sent, abs=1e-6))
        round_trips_ms.append((time.perf_counter() - sent_s) * 1e3)
    forth.send(JoyFeedback(1, 0, 2.0))
    assert result_of(node)["received"] == COUNT
    peer.node.close()
    report(capsys, f"{ros.name}: JoyFeedback there and back", round_trips_ms)
