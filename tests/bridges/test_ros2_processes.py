"""Two processes exchange every ROS 2 topic; the DDS library's tools verify names and types."""

import math
import os
import queue
import re
import subprocess
import sys
import time
from contextlib import suppress

import msgspec
import pytest
from ros_network import broken_program, loopback, running

pytest.importorskip("cyclonedds")

from haptigraph.graph import SceneGraph
from haptigraph.recording.codec import encode_jpeg
from haptigraph.ros2.geometry_types import JointState, PoseWithCovarianceStamped, TFMessage
from haptigraph.ros2.types import (
    CompressedImage,
    DiagnosticArray,
    Header,
    Image,
    Joy,
    JoyFeedback,
    PointStamped,
    Time,
)
from haptigraph.sources.phantom import PhantomSource

pytestmark = pytest.mark.timeout(240)

DDS_TYPES = {
    "rt/haptigraph/state": "diagnostic_msgs::msg::dds_::DiagnosticArray_",
    "rt/haptigraph/graph": "diagnostic_msgs::msg::dds_::DiagnosticArray_",
    "rt/haptigraph/needle_tip": "geometry_msgs::msg::dds_::PointStamped_",
    "rt/haptigraph/needle": "geometry_msgs::msg::dds_::PoseWithCovarianceStamped_",
    "rt/haptigraph/theta": "sensor_msgs::msg::dds_::JointState_",
    "rt/haptigraph/touch": "sensor_msgs::msg::dds_::JointState_",
    "rt/tf": "tf2_msgs::msg::dds_::TFMessage_",
    "rt/tf_static": "tf2_msgs::msg::dds_::TFMessage_",
    "rt/joy/set_feedback": "sensor_msgs::msg::dds_::JoyFeedback_",
    "rt/diagnostics": "diagnostic_msgs::msg::dds_::DiagnosticArray_",
    "rt/joy": "sensor_msgs::msg::dds_::Joy_",
}
IDL = {
    "rt/haptigraph/needle_tip": [
        "Header_ header",
        "string frame_id",
        "double x",
        "double y",
        "double z",
        "Point_ point",
    ],
    "rt/haptigraph/needle": [
        "double covariance[36]",
        "PoseWithCovariance_ pose",
        "Quaternion_ orientation",
        "Point_ position",
        "double w",
    ],
    "rt/haptigraph/theta": [
        "sequence<string>  name",
        "sequence<double>  position",
        "sequence<double>  velocity",
        "sequence<double>  effort",
    ],
    "rt/tf": [
        "string child_frame_id",
        "Transform_ transform",
        "Vector3_ translation",
        "TransformStamped_>  transforms",
    ],
    "rt/joy/set_feedback": ["octet type", "octet id", "float intensity"],
    "rt/diagnostics": [
        "byte level",
        "string hardware_id",
        "KeyValue_>  values",
        "DiagnosticStatus_>  status",
    ],
    "rt/joy": ["sequence<float>  axes", "sequence<long>  buttons"],
}


@pytest.fixture(scope="module")
def steered(ros_network):
    with running("teleop:tests/data/steered.toml", "--bridge", "ros2", "--device", "ros2") as process:
        yield process
    assert "interrupted" in process.output


def cyclonedds(*arguments, is_complete=lambda output: True):
    """The output of the DDS library's tool, with increasing runtimes until it is complete."""
    for runtime in ("1s", "4s", "12s"):
        output = run_tool(runtime, *arguments)
        if is_complete(output):
            break
    return output


def run_tool(runtime, *arguments):
    tool = [sys.executable, "-c", "from cyclonedds.tools.cli.main import cli; cli()", *arguments]
    tag = re.search("<Tag>(.*?)</Tag>", os.environ["CYCLONEDDS_URI"])[1]
    environment = {**os.environ, **loopback(tag, ignored="1.15"), "COLUMNS": "120"}
    domain = (
        "--id",
        os.environ["ROS_DOMAIN_ID"],
        "-r",
        runtime,
        "--suppress-progress-bar",
        "--color",
        "none",
    )
    return subprocess.run(
        [*tool, *domain], env=environment, capture_output=True, text=True, timeout=60
    ).stdout


def state_of(message):
    return message.status[0].message


def test_every_topic_of_a_run_arrives_in_ros_units(steered, peer):
    for topic, kind in {
        "/haptigraph/state": DiagnosticArray,
        "/haptigraph/graph": DiagnosticArray,
        "/haptigraph/needle_tip": PointStamped,
        "/haptigraph/needle": PoseWithCovarianceStamped,
        "/haptigraph/theta": JointState,
        "/haptigraph/touch": JointState,
        "/tf": TFMessage,
        "/tf_static": TFMessage,
        "/joy/set_feedback": JoyFeedback,
        "/diagnostics": DiagnosticArray,
    }.items():
        peer.subscribe(topic, kind)
    graph_message = peer.next("/haptigraph/graph")
    stamp = graph_message.header.stamp

    def of_the_same_image(message):
        return (message.transforms[0] if isinstance(message, TFMessage) else message).header.stamp == stamp

    graph = msgspec.json.decode(graph_message.status[0].message, type=SceneGraph)
    assert state_of(peer.next("/haptigraph/state", of_the_same_image)) == "misaligned_intraocular_navigation"
    theta = peer.next("/haptigraph/theta", of_the_same_image)
    assert math.degrees(theta.position[0]) == pytest.approx(graph.measures["theta_deg"])
    tip = peer.next("/haptigraph/needle_tip", of_the_same_image)
    assert tip.header.frame_id == "haptigraph_eye"
    assert abs(time.time_ns() - tip.header.stamp.ns) < 10e9
    assert 0.001 < math.hypot(tip.point.x, tip.point.y) < 0.015  # in an eye of 24 mm, in metres
    assert tip.point.z == 0.0
    pose = peer.next("/haptigraph/needle", of_the_same_image).pose
    assert pose.pose.position == tip.point
    assert 0 < pose.covariance[0] < 0.0002**2
    (transform,) = peer.next("/tf", of_the_same_image).transforms
    assert transform.transform.rotation == pose.pose.orientation
    (trocar,) = peer.next("/tf_static").transforms  # sent before the peer came
    assert trocar.child_frame_id == "haptigraph_trocar"
    rumble = peer.next("/joy/set_feedback", lambda message: message.intensity > 0)
    assert (rumble.type, rumble.id, rumble.intensity) == (1, 0, pytest.approx(0.3))
    (status,) = peer.next("/diagnostics", lambda message: message.status[0].level == 0).status
    assert (status.name, status.message) == ("haptigraph: loop", "ok")
    values = {pair.key: pair.value for pair in status.values}
    assert values["state"] == "misaligned_intraocular_navigation"
    assert float(values["image_rate_hz"]) > 3


def test_a_joystick_steers_the_needle_while_its_clutch_is_engaged(steered, peer):
    peer.subscribe("/haptigraph/needle_tip", PointStamped)
    before = peer.next("/haptigraph/needle_tip").point
    joy, moved = peer.publisher("/joy", Joy), 0.0
    for _ in range(300):
        joy.send(Joy(Header(), [0.0, -1.0], [0, 0, 0, 0, 0, 1]))
        after = peer.next("/haptigraph/needle_tip").point
        moved = math.hypot(after.x - before.x, after.y - before.y)
        if moved > 0.002:
            break
    assert moved > 0.002
    assert after.y < before.y  # back on the stick is down in the image, into the eye


def test_every_change_of_the_haptic_output_is_published(steered, peer):
    peer.subscribe("/haptigraph/touch", JointState)
    peer.subscribe("/haptigraph/state", DiagnosticArray)
    joy = peer.publisher("/joy", Joy)
    for _ in range(600):  # into the retina, where the output pulses
        joy.send(Joy(Header(), [0.0, -1.0], [0, 0, 0, 0, 0, 1]))
        if state_of(peer.next("/haptigraph/state")) == "retinal_contact":
            break
    for level in (1.0, 0.0, 1.0):
        peer.next("/haptigraph/touch", lambda output, level=level: list(output.effort) == [level])


def topics(output):
    found = re.findall(r"(rt/\S+) ─.*?Typename\s+│\s+(\S+) ", output, re.DOTALL)
    return {name: kind for name, kind in found if name in DDS_TYPES}


def test_the_dds_tools_show_ros_names_and_types(steered):
    output = cyclonedds("ls", is_complete=lambda output: topics(output) == DDS_TYPES)
    assert topics(output) == DDS_TYPES


@pytest.mark.slow  # the tool runs for seconds
@pytest.mark.parametrize("topic", IDL)
def test_the_dds_tools_show_ros_fields(steered, topic):
    idl = cyclonedds("typeof", topic, is_complete=lambda output: "struct" in output)
    assert "@final" in idl
    package, _, kind = DDS_TYPES[topic].partition("::msg::dds_::")
    assert f"module {package}" in idl and f"struct {kind}" in idl
    for field in IDL[topic]:
        assert field in idl


def stamped_images():
    """Images of the phantom, alternately raw and compressed, stamped with the current time."""
    image = PhantomSource("tests/data/steered.toml").read(1.0).image
    height, width = image.shape[:2]
    encoded = encode_jpeg(image, 95)
    while True:
        header = Header(Time.from_ns(time.time_ns()), "camera")
        yield Image(header, height, width, "bgr8", 0, 3 * width, image.tobytes())
        header = Header(Time.from_ns(time.time_ns()), "camera")
        yield CompressedImage(header, "jpeg", encoded)


@pytest.fixture
def eye(tmp_path):
    path = tmp_path / "eye.toml"
    path.write_text(PhantomSource("tests/data/steered.toml").registration)
    return path


def test_images_of_either_type_return_the_position_of_the_needle(ros_network, peer, eye):
    with running("ros2:/camera/image", "--registration", eye, "--bridge", "ros2:rig_b") as process:
        peer.subscribe("/rig_b/needle_tip", PointStamped)
        peer.subscribe("/rig_b/state", DiagnosticArray)
        publishers = {kind: peer.publisher("/camera/image", kind) for kind in (Image, CompressedImage)}
        received = {Image: 0, CompressedImage: 0}
        for _, image in zip(range(100), stamped_images(), strict=False):
            publishers[type(image)].send(image)
            with suppress(queue.Empty):  # the run may miss the first ones
                while True:
                    tip = peer.received["/rig_b/needle_tip"].get(timeout=1.0)
                    if tip.header.stamp == image.header.stamp:
                        break
                peer.next("/rig_b/state", lambda state, stamp=tip.header.stamp: state.header.stamp == stamp)
                received[type(image)] += 1
            if min(received.values()) == 10:
                break
        assert min(received.values()) == 10
    assert "rejected" not in process.output


def test_invalid_messages_disturb_neither_loop_nor_images(ros_network, peer, eye):
    arguments = ("ros2:/camera/image", "--registration", eye, "--bridge", "ros2:rig_c")
    with running(*arguments) as process, broken_program():
        peer.subscribe("/rig_c/state", DiagnosticArray)
        publisher, images = peer.publisher("/camera/image", CompressedImage), stamped_images()
        for _ in range(600):
            image = next(images)
            if isinstance(image, CompressedImage):
                publisher.send(image)
            state = state_of(peer.next("/rig_c/state"))
            if state == "misaligned_intraocular_navigation":
                break
        assert state == "misaligned_intraocular_navigation"
        assert process.poll() is None
    assert "! source: ros2:/camera/image: rejected " in process.output
    assert "Traceback" not in process.output


def test_invalid_joystick_messages_neither_steer_nor_disturb(ros_network, peer):
    diagnostics = ""
    with running("teleop:tests/data/steered.toml", "--bridge", "ros2:rig_e") as process:
        peer.subscribe("/rig_e/state", DiagnosticArray)
        assert state_of(peer.next("/rig_e/state")) == "misaligned_intraocular_navigation"
        peer.subscribe("/diagnostics", DiagnosticArray)
        problems = [
            "joy has an axis at nan",
            "joy has 0 axes and 0 buttons; axes 0 and 1 and button 5 are used",
        ]
        with broken_program():
            while not all(problem in diagnostics for problem in problems):
                diagnostics += str(peer.next("/diagnostics").status)
        for _ in range(10):
            assert state_of(peer.next("/rig_e/state")) == "misaligned_intraocular_navigation"
    for problem in problems:
        assert process.output.count(f"! bridge: ros2: rejected a message on /joy: {problem}") == 1
