"""robot calibrate with a robot and a tf broadcaster in processes of their own."""

import math
import queue
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


class Touching:
    """`haptigraph robot calibrate --robot ...` in a process of its own, and who moves the robot for it."""

    def __init__(self, peer, arm, topic, *command):
        self.peer, self.arm, self.topic = peer, arm, topic
        self.program = subprocess.Popen(
            [sys.executable, "-m", "haptigraph", "robot", "calibrate", *map(str, command)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            bufsize=1,
        )

    def read_question(self):
        """Return what the program prints until it asks for a point, or ends."""
        asked = ""
        while not asked.endswith("press Enter: ") and (read := self.program.stdout.read(1)):
            asked += read
        return asked

    def touch(self, eye_mm):
        """Move the robot to a point of the eye."""
        self.at_mm = EYE_FROM_BASE.inverse().point_mm(np.array(eye_mm)).tolist()
        self.arm.stdin.write(f"at {' '.join(map(str, self.at_mm))}\n")
        self.peer.next(self.topic, lambda message: is_at(message, self.at_mm))

    def press_enter(self):
        self.program.stdin.write("\n")

    def touch_all(self, asked, points):
        """Touch points, again where the machine stalled; return what the program prints afterwards."""
        for name in points:
            assert f"touch {name} " in asked
            while f"touch {name} " in asked:
                self.touch(POINTS[name])
                self.press_enter()
                asked = self.read_question()
        return asked

    def fall_silent(self):
        """Make the robot send no more poses, and wait until none is under way."""
        self.arm.stdin.write("quiet\n")
        with pytest.raises(queue.Empty):
            while True:
                self.peer.received[self.topic].get(timeout=1)

    def shake(self):
        self.arm.stdin.write("shake\n")
        self.peer.next(self.topic, lambda message: not is_at(message, self.at_mm))


@pytest.fixture
def touching(peer, tmp_path):
    name = f"arm_{uuid.uuid4().hex}"
    points, output = tmp_path / "points.csv", tmp_path / "robot.toml"
    rows = [",".join((point, *map(str, eye_mm))) for point, eye_mm in POINTS.items()]
    points.write_text("\n".join(("name,eye_x_mm,eye_y_mm,eye_z_mm", *rows)))
    command = ("-o", output, "--points", points, "--robot", f"crtk:{name}", "--sd-mm", "0.02")
    peer.subscribe(f"/{name}/measured_cp", PoseStamped)
    with robot_peer("crtk", f"/{name}") as arm:
        touching = Touching(peer, arm, f"/{name}/measured_cp", *command)
        try:
            yield touching
        finally:
            touching.program.kill()
            touching.program.communicate()


def test_a_robot_on_the_network_touches_the_points(touching, tmp_path):
    """Its user moves it to each point, and presses Enter."""
    report = touching.touch_all(touching.read_question(), POINTS)
    assert touching.program.wait(60) == 0, report
    setup = load_setup(tmp_path / "robot.toml")
    for eye_mm in POINTS.values():
        there_mm = EYE_FROM_BASE.inverse().point_mm(np.array(eye_mm))
        assert math.dist(setup.eye.robot_from_eye.point_mm(np.array(eye_mm)), there_mm) < 0.05
    assert math.dist(setup.rcm.at_mm, EYE_FROM_BASE.inverse().point_mm(np.array(POINTS["trocar"]))) < 0.05
    assert 0.02 <= setup.eye.tip_sd_mm < 0.05


@pytest.mark.parametrize(
    ("disturb", "reason"),
    [(Touching.fall_silent, "reported no pose"), (Touching.shake, "the robot moved by")],
    ids=["not heard", "moved"],
)
def test_asks_again_for_a_point_that_was_not_taken(touching, disturb, reason):
    """Points that were touched before are kept."""
    first, second, *rest = POINTS
    touching.touch_all(touching.read_question(), [first])
    disturb(touching)
    touching.press_enter()
    asked = touching.read_question()
    assert reason in asked and f"touch {second} " in asked
    touching.arm.stdin.write("steady\n")
    report = touching.touch_all(asked, [second, *rest])
    assert touching.program.wait(60) == 0, report


def test_a_robot_that_is_never_heard_ends_the_command(ros_network, tmp_path):
    points = tmp_path / "points.csv"
    points.write_text("name,eye_x_mm,eye_y_mm,eye_z_mm\ntrocar,-7,10,0\n")
    arguments = ("-o", tmp_path / "robot.toml", "--points", points, "--robot", f"crtk:arm_{uuid.uuid4().hex}")
    assert "reported no pose for 5 s" in refuse("robot", "calibrate", *arguments)


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
