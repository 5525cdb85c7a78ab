"""Real ROS 2 nodes (Jazzy and Kilted, rclpy) and haptigraph understand each other. `make interop` sets it up."""

import json
import os
import queue
import subprocess
import sys
import time
from pathlib import Path

import msgspec
import numpy as np
import pytest
from ros_network import Peer, loopback, running

pytest.importorskip("cyclonedds")

from haptigraph.graph import SceneGraph
from haptigraph.recording.codec import encode_jpeg
from haptigraph.ros2.types import Joy, JoyFeedback
from haptigraph.sources.phantom import PhantomSource

HERE = Path(__file__).parent
ENVIRONMENTS = Path(__file__).parents[2] / ".interop"
COUNT = 1000
pytestmark = [pytest.mark.slow, pytest.mark.timeout(600), pytest.mark.xdist_group("ros2")]


@pytest.fixture(scope="module", params=["jazzy", "kilted"])
def ros(request):
    """Start a real node in a role; its answer comes when it ends."""
    python = ENVIRONMENTS / request.param / "bin" / "python"
    if not python.exists():
        pytest.skip(f"ROS 2 {request.param} is not set up; `make interop` does it")
    with pytest.MonkeyPatch.context() as patch:
        for name, value in loopback(ignored="1.15").items():  # without a tag, which only Cyclone knows
            patch.setenv(name, value)

        started = []

        def start(*arguments):
            environment = {
                name: value
                for name, value in os.environ.items()
                if name not in ("PYTHONPATH", "CYCLONEDDS_URI")
            }
            environment |= {
                "RMW_IMPLEMENTATION": "rmw_fastrtps_cpp",
                "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
            }
            script = (python, HERE / "ros_node.py", *map(str, arguments))
            started.append(subprocess.Popen(script, stdout=subprocess.PIPE, text=True, env=environment))
            return started[-1]

        start.name = request.param
        yield start
        for process in started:
            process.kill()
            process.communicate()


def answer(node):
    told, _ = node.communicate(timeout=300)
    assert node.returncode == 0, told
    return json.loads(told.splitlines()[-1])


@pytest.fixture(scope="module")
def eye(tmp_path_factory):
    """A registration, and pictures of a needle inside the eye."""
    folder = tmp_path_factory.mktemp("eye")
    source = PhantomSource("align_then_approach")
    (folder / "eye.toml").write_text(source.registration)
    for number in range(150):
        image = source.read(1.0).image
        if number >= 120:
            (folder / f"{number}.jpg").write_bytes(encode_jpeg(image, 80))
    return folder


def tell(capsys, name, round_trips_ms):
    p50, p99 = np.percentile(round_trips_ms, [50, 99])
    with capsys.disabled():
        sys.stdout.write(f"\n{name}: {len(round_trips_ms)} of {COUNT}, p50 {p50:.2f} ms, p99 {p99:.2f} ms\n")


def test_a_ros_node_sends_images_and_receives_every_topic(ros, eye, capsys):
    arguments = ("ros2:/camera/image/compressed", "--registration", eye / "eye.toml")
    with running(*arguments, "--bridge", "ros2", "--device", "ros2") as process:
        met = answer(ros("camera", eye, COUNT))
    assert len(met["round_trips_ms"]) == COUNT, process.output
    tell(capsys, f"{ros.name}: image to needle tip", met["round_trips_ms"])
    assert met["frame_id"] == "haptigraph_eye"
    assert all(abs(place) < 0.013 for place in met["tip_m"])
    assert "needle_tip" in {node.id for node in msgspec.json.decode(met["graph"], type=SceneGraph).nodes}
    assert met["counts"]["/haptigraph/state"] >= COUNT
    assert met["counts"]["/haptigraph/graph"] >= COUNT
    assert met["counts"]["/haptigraph/theta"] >= COUNT
    assert met["counts"]["/haptigraph/touch"] > 0
    assert met["counts"]["/joy/set_feedback"] > 0
    assert met["counts"]["/diagnostics"] > 0
    assert met["level"] in (0, 1)
    assert met["types"]["/haptigraph/needle_tip"] == ["geometry_msgs/msg/PointStamped"]
    assert met["types"]["/diagnostics"] == ["diagnostic_msgs/msg/DiagnosticArray"]


def test_a_ros_joystick_steers_and_no_message_is_lost(ros):
    peer = Peer()
    peer.hear("/joy", Joy)
    with running("teleop:tests/data/steered.toml", "--bridge", "ros2"):
        moved_mm = answer(ros("stick", COUNT))["moved_mm"]
    heard = [peer.heard["/joy"].get(timeout=1.0) for _ in range(COUNT)]
    peer.node.close()
    assert [joy.header.stamp.sec for joy in heard] == list(range(COUNT))
    assert (list(heard[0].axes), list(heard[0].buttons)) == ([0.0, 1.0, 0.5], [0, 0, 0, 0, 0, 1])
    assert moved_mm > 2


def test_touch_goes_to_a_ros_node_and_back(ros, capsys):
    node, peer = ros("echo"), Peer()
    peer.hear("/back", JoyFeedback)
    forth = peer.say("/forth", JoyFeedback)
    for _ in range(100):  # until the way back is known, too; not counted
        forth.send(JoyFeedback(1, 0, -1.0))
        try:
            peer.heard["/back"].get(timeout=0.2)
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
    assert answer(node)["heard"] == COUNT
    peer.node.close()
    tell(capsys, f"{ros.name}: JoyFeedback there and back", round_trips_ms)
