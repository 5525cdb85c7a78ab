import math

import msgspec
import numpy as np
import pytest
from helpers import make_step
from msgspec.structs import replace

pytest.importorskip("cyclonedds")

from haptigraph.bridges.ros2 import TOPICS
from haptigraph.bridges.ros2_messages import StepMessages
from haptigraph.geometry import Point, Segment
from haptigraph.graph import SceneGraph
from haptigraph.messages import CameraStamp, Capture, Certainty, Conclusion
from haptigraph.registration.loading import parse_registration
from haptigraph.robot.place.tf import eye_place

IMAGE = np.zeros((4, 4), np.uint8)
LINE = Segment((2.0, 10.0), (1.0, -4.0))
FOUND = {"needle_line": LINE, "needle_tip": Point((1.0, -4.0))}
STATES = {"retinal_contact": 2, "misaligned_retinal_approach": 1, "target_hit": 0, "unknown": 3}


def step_with(stamp_ns=0, state="outside_eye", measures=None, **observed):
    step = make_step(stamp_ns=stamp_ns)
    return replace(
        step,
        observation=replace(step.observation, **observed),
        graph=SceneGraph(stamp_ns, (), (), measures or {}),
        conclusion=Conclusion(stamp_ns, state, 1, "low", "it is so"),
    )


def by_topic(run, step, capture=None, name="haptigraph"):
    capture = capture or Capture(7, step.stamp_ns, IMAGE)
    return dict(StepMessages(name, run).of_step(capture, step))


def stamps(messages):
    headers = [
        message.transforms[0].header if topic == "/tf" else message.header
        for topic, message in messages.items()
    ]
    return {header.stamp.ns for header in headers}


def test_every_message_of_a_step_has_the_time_of_its_image(run):
    messages = by_topic(run, step_with(5, measures={"theta_deg": 3.0}, found=FOUND))
    assert set(messages) == set(TOPICS) - {"touch", "/tf_static", "/diagnostics"}
    assert stamps(messages) == {10**18 + 5}


def test_the_stamp_of_an_image_from_ros_is_passed_on_unchanged(run):
    step, camera = step_with(5, found=FOUND), CameraStamp("ros", 1_700_000_000_123_456_789, 6)
    assert stamps(by_topic(run, step, Capture(7, 5, IMAGE, camera=camera))) == {camera.stamp_ns}
    assert stamps(by_topic(run, step, Capture(7, 5, None, camera=camera))) == {10**18 + 5}  # has no image
    other = replace(camera, clock="hardware")
    assert stamps(by_topic(run, step, Capture(7, 5, IMAGE, camera=other))) == {10**18 + 5}


@pytest.mark.parametrize(("state", "level"), STATES.items())
def test_the_level_of_a_state_is_that_of_its_kind(run, state, level):
    (status,) = by_topic(run, step_with(state=state))["state"].status
    assert (status.level, status.message, status.name) == (level, state, "haptigraph: state")
    values = {pair.key: pair.value for pair in status.values}
    assert (values["reason"], values["pattern"], values["image"]) == ("it is so", "low", "7")
    assert "tip_sd_mm" not in values


def test_the_state_says_how_certain_the_needle_is(run):
    step = step_with(found=FOUND, certainty=Certainty(0.91, 0.08, 0.4))
    (status,) = by_topic(run, step)["state"].status
    values = {pair.key: pair.value for pair in status.values}
    assert (values["confidence"], values["tip_sd_mm"], values["theta_sd_deg"]) == ("0.910", "0.0800", "0.400")
    hidden = step_with(found={"needle_line": LINE}, certainty=Certainty(0.5, None, 0.4))
    messages = by_topic(run, hidden)
    assert "tip_sd_mm" not in {pair.key for pair in messages["state"].status[0].values}
    assert set(messages) == {"state", "graph"}  # no tip, so no pose


def test_the_graph_is_the_json_of_a_recording(run):
    step = step_with(measures={"theta_deg": 3.0})
    (status,) = by_topic(run, step)["graph"].status
    assert msgspec.json.decode(status.message, type=SceneGraph) == step.graph


def test_theta_and_output_are_joint_states(run):
    theta = by_topic(run, step_with(measures={"theta_deg": 3.0}))["theta"]
    assert (theta.name, list(theta.position)) == (["theta"], [math.radians(3.0)])
    assert (theta.header.frame_id, theta.velocity, theta.effort) == ("haptigraph_eye", [], [])
    touch = StepMessages("haptigraph", run).of_output(9, 0.3)
    assert (touch.name, list(touch.effort), touch.header.stamp.ns) == (["touch"], [0.3], 10**18 + 9)


def test_pose_point_and_transform_of_the_needle_agree(run):
    messages = by_topic(run, step_with(found=FOUND, certainty=Certainty(0.9, 0.08, 0.4)))
    tip, pose = messages["needle_tip"].point, messages["needle"].pose
    (transform,) = messages["/tf"].transforms
    assert (tip.x, tip.y, tip.z) == (0.001, -0.004, 0.0)
    assert pose.pose.position == tip
    assert transform.transform.translation == type(transform.transform.translation)(tip.x, tip.y, tip.z)
    assert transform.transform.rotation == pose.pose.orientation
    assert (transform.header.frame_id, transform.child_frame_id) == (
        "haptigraph_eye",
        "haptigraph_needle_tip",
    )
    assert len(pose.covariance) == 36
    assert pose.covariance[0] == pytest.approx((8e-5) ** 2)
    assert pose.covariance[35] == pytest.approx(math.radians(0.4) ** 2)


def test_two_rigs_have_frames_of_their_own(run):
    (transform,) = by_topic(run, step_with(found=FOUND), name="lab/rig_b")["/tf"].transforms
    assert (transform.header.frame_id, transform.child_frame_id) == (
        "lab_rig_b_eye",
        "lab_rig_b_needle_tip",
    )


def test_the_trocar_is_a_static_transform_where_it_is_registered(run):
    (transform,) = StepMessages("haptigraph", run).of_static_frames(run).transforms
    trocar = parse_registration(run.info.registration, "r").anatomy["trocar"]
    assert transform.child_frame_id == "haptigraph_trocar"
    assert transform.transform.translation.x == pytest.approx(trocar.at_mm[0] / 1e3)
    assert transform.transform.translation.y == pytest.approx(trocar.at_mm[1] / 1e3)


def test_a_calibrated_robot_is_placed_beside_the_trocar(run):
    setup = (
        "[rcm]\nat_mm = [0.0, 0.0, 0.0]\n[eye]\ntranslation_mm = [41.0, -87.0, 132.0]\n"
        "quaternion = [0.36, 0.48, -0.64, 0.48]\ntip_sd_mm = 0.1\n"
    )
    placed = replace(run, info=replace(run.info, robot_setup=setup))
    message = StepMessages("haptigraph", placed).of_static_frames(placed)
    assert [one.child_frame_id for one in message.transforms] == ["haptigraph_trocar", "haptigraph_eye"]
    assert message.transforms[1].header.frame_id == "haptigraph_robot_base"
    eye = eye_place(message, "haptigraph_robot_base", 0.2)
    assert eye.translation_mm == pytest.approx((41.0, -87.0, 132.0)) and eye.tip_sd_mm == 0.2
    assert eye.quaternion == pytest.approx((0.36, 0.48, -0.64, 0.48))
    assert eye_place(message, "another_base", 0.2) is None


def test_every_message_survives_the_network_format(run):
    step = step_with(5, measures={"theta_deg": 3.0}, found=FOUND, certainty=Certainty(0.9, 0.08, 0.4))
    messages = by_topic(run, step) | {"/tf_static": StepMessages("haptigraph", run).of_static_frames(run)}
    for topic, message in messages.items():
        assert TOPICS[topic].deserialize(message.serialize()) == message
