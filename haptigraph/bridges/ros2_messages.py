"""Turn a step into stamped ROS 2 messages, by topic.

All messages of a step have the stamp of its image, so that `message_filters` pairs them with the image and
with each other. Units follow REP 103 (metres, radians).
"""

import math
from collections.abc import Iterator
from typing import Any

import msgspec
import numpy as np

from haptigraph.assemble import parse_procedure
from haptigraph.bridges.bridge import RunContext
from haptigraph.bridges.diagnostics import ERROR, OK, STALE, WARN, diagnostic_status
from haptigraph.bridges.needle_pose import found_needle, needle_matrix, pose_covariance
from haptigraph.geometry import Point as EyePoint
from haptigraph.inference.meaning import Kind
from haptigraph.messages import Capture, Step
from haptigraph.registration.loading import parse_registration
from haptigraph.robot.pose import ToolPose, Vec3, quaternion_of
from haptigraph.robot.ros.poses import as_message
from haptigraph.robot.setup import parse_setup
from haptigraph.ros2.geometry_types import (
    JointState,
    Pose,
    PoseWithCovariance,
    PoseWithCovarianceStamped,
    TFMessage,
    Transform,
    TransformStamped,
    Vector3,
)
from haptigraph.ros2.types import (
    DiagnosticArray,
    DiagnosticStatus,
    Header,
    PointStamped,
    Time,
)

__all__ = ["StepMessages"]

LEVELS: dict[Kind, int] = {"alarm": ERROR, "guidance": WARN, "success": OK, "neutral": OK, "unseen": STALE}


class StepMessages:
    """The messages of one run.

    Args:
        name: Of the run's topics and coordinate frames: NAME_eye, NAME_needle_tip, NAME_trocar.
        run: The run.
    """

    def __init__(self, name: str, run: RunContext) -> None:
        self._name, self._frame = name, name.replace("/", "_")
        self._utc_offset_ns = run.info.utc_offset_ns
        self._is_volume = run.image.slices is not None
        self._kinds = parse_procedure(run.info.procedure, "the run's procedure").kinds

    def of_step(self, capture: Capture, step: Step) -> Iterator[tuple[str, Any]]:
        """Yield topic and message; theta, tip and pose only if they are known."""
        stamp = self._image_stamp(capture, step)
        header = Header(stamp, f"{self._frame}_eye")
        yield "state", DiagnosticArray(header, [self._state(capture, step)])
        graph = msgspec.json.encode(step.graph).decode()
        yield "graph", DiagnosticArray(header, [diagnostic_status(self._name, "graph", OK, graph, {})])
        theta_deg = step.graph.measures.get("theta_deg")
        if theta_deg is not None:
            yield "theta", JointState(header, ["theta"], position=[math.radians(theta_deg)])
        tip = step.observation.found.get("needle_tip")
        if isinstance(tip, EyePoint):
            yield "needle_tip", PointStamped(header, as_message(ToolPose(_position_mm(tip))).position)
        if needle := found_needle(step.observation):
            matrix = needle_matrix(*needle)
            covariance = pose_covariance(matrix, step.observation.certainty, is_volume=self._is_volume)
            rotation = quaternion_of(np.array(matrix)[:, :3])
            pose = as_message(ToolPose(_position_mm(needle[1]), rotation))
            with_covariance = PoseWithCovariance(pose, covariance.ravel().tolist())
            yield "needle", PoseWithCovarianceStamped(header, with_covariance)
            yield "/tf", TFMessage([self._transform(stamp, "eye", "needle_tip", pose)])

    def of_output(self, stamp_ns: int, amplitude: float) -> JointState:
        """Return the message of the haptic output from `stamp_ns` on."""
        header = Header(Time.from_ns(stamp_ns + self._utc_offset_ns))
        return JointState(header, ["touch"], effort=[amplitude])

    def of_static_frames(self, run: RunContext) -> TFMessage | None:
        """Return the static transforms: to the trocar, and from the robot's base to the eye; None if none.

        The registration of B-scans has no trocar. Both are in one message, because only the last one reaches
        subscribers that come later.
        """
        stamp = Time.from_ns(run.clock.now_ns() + self._utc_offset_ns)
        transforms = list[TransformStamped]()
        trocar = parse_registration(run.info.registration, "the run's registration").anatomy.get("trocar")
        if isinstance(trocar, EyePoint):
            pose = as_message(ToolPose(_position_mm(trocar)))
            transforms.append(self._transform(stamp, "eye", "trocar", pose))
        setup = parse_setup(run.info.robot_setup, "the run's robot.toml") if run.info.robot_setup else None
        if setup is not None and setup.eye is not None:
            pose = as_message(ToolPose(setup.eye.translation_mm, setup.eye.quaternion))
            transforms.append(self._transform(stamp, "robot_base", "eye", pose))
        return TFMessage(transforms) if transforms else None

    def _image_stamp(self, capture: Capture, step: Step) -> Time:
        """Return the stamp of the step's image; that of an image from ROS is the one in its header."""
        camera = capture.camera
        if capture.image is not None and camera is not None and camera.clock == "ros":
            return Time.from_ns(camera.stamp_ns)
        return Time.from_ns(step.stamp_ns + self._utc_offset_ns)

    def _state(self, capture: Capture, step: Step) -> DiagnosticStatus:
        conclusion, certainty = step.conclusion, step.observation.certainty
        kind = self._kinds.get(conclusion.state, "unseen")
        values = {
            "reason": conclusion.because,
            "kind": kind,
            "pattern": conclusion.feel,
            "command": step.command.pattern.name,
            "image": str(capture.index) if capture.image is not None else "",
        }
        if certainty is not None:
            values["confidence"] = f"{certainty.confidence:.3f}"
            values["theta_sd_deg"] = f"{certainty.theta_sd_deg:.3f}"
            if certainty.tip_sd_mm is not None:
                values["tip_sd_mm"] = f"{certainty.tip_sd_mm:.4f}"
        return diagnostic_status(self._name, "state", LEVELS[kind], conclusion.state, values)

    def _transform(self, stamp: Time, parent: str, child: str, pose: Pose) -> TransformStamped:
        translation = Vector3(pose.position.x, pose.position.y, pose.position.z)
        placed = Transform(translation, pose.orientation)
        return TransformStamped(Header(stamp, f"{self._frame}_{parent}"), f"{self._frame}_{child}", placed)


def _position_mm(point: EyePoint) -> Vec3:
    return (*point.at_mm, point.z_mm)
