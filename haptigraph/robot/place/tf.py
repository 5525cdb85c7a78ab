"""The eye's place in ROS's tf: from its transform to the [eye] table."""

import queue
import time
from contextlib import closing

from haptigraph.errors import BadInput
from haptigraph.robot.ros.poses import tool_pose
from haptigraph.robot.setup import EyePlace
from haptigraph.ros2.geometry_types import TFMessage, TransformStamped
from haptigraph.ros2.node import Node

__all__ = ["EYE_FRAME", "TF_TOPICS", "eye_place", "listen_for_eye"]

EYE_FRAME = "haptigraph_eye"
TF_TOPICS = ("/tf_static", "/tf")
TIMEOUT_S = 5.0


def eye_place(message: TFMessage, base_frame: str, sd_mm: float) -> EyePlace | None:
    """Return where a message says that the eye is; None if it does not.

    Args:
        message: Of /tf or /tf_static.
        base_frame: The robot's base, in which poses are measured.
        sd_mm: Standard deviation of the robot's tip in the eye frame, which tf does not carry.

    Raises:
        BadInput: If the transform is no rotation.
    """
    for one in message.transforms:
        if (one.header.frame_id.lstrip("/"), one.child_frame_id.lstrip("/")) == (base_frame, EYE_FRAME):
            return _place(one, sd_mm)
    return None


def listen_for_eye(base_frame: str, sd_mm: float, timeout_s: float = TIMEOUT_S) -> EyePlace:
    """Wait for the transform from the robot's base to the eye.

    Raises:
        BadInput: If it does not come, or is no rotation.
        MissingExtra: If cyclonedds is not installed.
    """
    received: queue.Queue[TFMessage] = queue.Queue()
    until_s, seen = time.monotonic() + timeout_s, set[str]()
    with closing(Node()) as node:
        for topic in TF_TOPICS:
            node.subscribe(topic, TFMessage, received.put, lambda problem: None)
        while (left_s := until_s - time.monotonic()) > 0:
            try:
                message = received.get(timeout=left_s)
            except queue.Empty:
                break
            if (place := eye_place(message, base_frame, sd_mm)) is not None:
                return place
            seen |= {f"{one.header.frame_id} -> {one.child_frame_id}" for one in message.transforms}
    found = f"found {', '.join(sorted(seen)[:8])}" if seen else "nothing is published there"
    raise BadInput(f"no transform {base_frame} -> {EYE_FRAME} on /tf or /tf_static; {found}")


def _place(transform: TransformStamped, sd_mm: float) -> EyePlace:
    try:
        pose = tool_pose(transform.transform.translation, transform.transform.rotation)
    except ValueError as error:
        raise BadInput(f"the transform to {EYE_FRAME}: {error}") from None
    return EyePlace(pose.position_mm, pose.quaternion, tip_sd_mm=sd_mm)
