"""robot calibrate with a robot and a tf broadcaster in processes of their own."""

import math
import subprocess
import sys
import uuid

import numpy as np
import pytest
from helpers import call, refuse
from ros_network import robot_peer

pytest.importorskip("cyclonedds")

from haptigraph.robot.place.tf import EYE_FRAME
from haptigraph.robot.pose import Transform, quaternion_of
from haptigraph.robot.setup import load_setup
from haptigraph.ros2.motion_types import PoseStamped

pytestmark = pytest.mark.realtime
POINTS = {
    "trocar": (-7.0, 10.0, 0.0),
    "target": (1.0, -11.9, 0.0),
    "left": (-11.0, -4.0, 0.0),
    "right": (11.0, -4.0, 0.5),
    "below": (0.0, -9.0, 3.0),
}
EYE_FROM_BASE = Transform(
    np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]]), np.array([9.0, 80.0, -40.0])
)
BROADCAST = """
import sys
from haptigraph.ros2.geometry_types import Quaternion, TFMessage, Transform, TransformStamped, Vector3
from haptigraph.ros2.node import Node
from haptigraph.ros2.types import Header, Time
numbers = [float(one) for one in sys.argv[2:]]
placed = Transform(Vector3(*numbers[:3]), Quaternion(*numbers[3:]))
node = Node()
node.publisher("/tf_static", TFMessage).send(TFMessage([TransformStamped(Header(Time(), "base"), sys.argv[1], placed)]))
print("sent", flush=True)
sys.stdin.read()
"""


def is_at(message, at_mm):
    at = message.pose.position
    return math.dist((1e3 * at.x, 1e3 * at.y, 1e3 * at.z), at_mm) < 0.1


def test_a_robot_on_the_network_touches_the_points(peer, tmp_path):
    """Its user moves it to each point, and presses Enter."""
    name = f"arm_{uuid.uuid4().hex}"
    points, output = tmp_path / "points.csv", tmp_path / "robot.toml"
    rows = [",".join((point, *map(str, eye_mm))) for point, eye_mm in POINTS.items()]
    points.write_text("\n".join(("name,eye_x_mm,eye_y_mm,eye_z_mm", *rows)))
    command = (
        "robot",
        "calibrate",
        "-o",
        output,
        "--points",
        points,
        "--robot",
        f"crtk:{name}",
        "--sd-mm",
        "0.02",
    )
    peer.subscribe(f"/{name}/measured_cp", PoseStamped)
    with robot_peer("crtk", f"/{name}") as arm:
        program = subprocess.Popen(
            [sys.executable, "-m", "haptigraph", *map(str, command)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            bufsize=1,
        )
        for point, eye_mm in POINTS.items():
            asked = ""
            while not asked.endswith("press Enter: "):
                asked += program.stdout.read(1)
            assert f"touch {point} " in asked
            there_mm = EYE_FROM_BASE.inverse().point_mm(np.array(eye_mm)).tolist()
            arm.stdin.write(f"at {' '.join(map(str, there_mm))}\n")
            peer.next(f"/{name}/measured_cp", lambda message, to_mm=there_mm: is_at(message, to_mm))
            program.stdin.write("\n")
        report, _ = program.communicate(timeout=60)
    assert program.returncode == 0, report
    setup = load_setup(output)
    for eye_mm in POINTS.values():
        there_mm = EYE_FROM_BASE.inverse().point_mm(np.array(eye_mm))
        assert math.dist(setup.eye.robot_from_eye.point_mm(np.array(eye_mm)), there_mm) < 0.05
    assert math.dist(setup.rcm.at_mm, EYE_FROM_BASE.inverse().point_mm(np.array(POINTS["trocar"]))) < 0.05
    assert 0.02 <= setup.eye.tip_sd_mm < 0.05


def test_the_eye_is_placed_by_tf(ros_network, aligned_run, tmp_path):
    output, base_from_eye = tmp_path / "robot.toml", EYE_FROM_BASE.inverse()
    numbers = (*(base_from_eye.translation_mm / 1e3).tolist(), *quaternion_of(base_from_eye.rotation))
    broadcaster = subprocess.Popen(
        [sys.executable, "-c", BROADCAST, EYE_FRAME, *map(str, numbers)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    try:
        assert broadcaster.stdout.readline() == "sent\n"
        arguments = ("robot", "calibrate", "-o", output, "--pivot", aligned_run, "--sd-mm", "0.3")
        assert call(*arguments, "--tf", "base").exit_code == 0
        assert "found base -> haptigraph_eye" in refuse(*arguments, "--tf", "table", "--force")
    finally:
        broadcaster.kill()
        broadcaster.communicate()
    eye = load_setup(output).eye
    np.testing.assert_allclose(eye.robot_from_eye.rotation, base_from_eye.rotation, atol=1e-9)
    assert math.dist(eye.translation_mm, base_from_eye.translation_mm) < 1e-6 and eye.tip_sd_mm == 0.3
