"""The ROS 2 messages of poses, transforms and joints, as DDS types with the fields of ROS's .msg files."""

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, TypeAlias

from cyclonedds.idl import IdlStruct, types
from cyclonedds.idl.annotations import autoid, final

from haptigraph.ros2.types import Header, Point

__all__ = [
    "POSE_COVARIANCE_SIZE",
    "JointState",
    "Pose",
    "PoseWithCovariance",
    "PoseWithCovarianceStamped",
    "Quaternion",
    "TFMessage",
    "Transform",
    "TransformStamped",
    "Vector3",
]

POSE_COVARIANCE_SIZE = 36
"""Row-major 6 x 6 matrix over x, y, z, rotation about x, about y, about z; fixed axes."""

if TYPE_CHECKING:
    Covariance: TypeAlias = list[float]
    Doubles: TypeAlias = list[float]
    Names: TypeAlias = list[str]
else:
    Covariance = types.array[types.float64, POSE_COVARIANCE_SIZE]
    Doubles = types.sequence[types.float64]
    Names = types.sequence[str]


@dataclass
@final
@autoid("sequential")
class Vector3(IdlStruct, typename="geometry_msgs::msg::dds_::Vector3_"):
    """geometry_msgs/Vector3."""

    x: types.float64 = 0.0
    y: types.float64 = 0.0
    z: types.float64 = 0.0


@dataclass
@final
@autoid("sequential")
class Quaternion(IdlStruct, typename="geometry_msgs::msg::dds_::Quaternion_"):
    """geometry_msgs/Quaternion: a rotation, of unit norm."""

    x: types.float64 = 0.0
    y: types.float64 = 0.0
    z: types.float64 = 0.0
    w: types.float64 = 1.0


@dataclass
@final
@autoid("sequential")
class Pose(IdlStruct, typename="geometry_msgs::msg::dds_::Pose_"):
    """geometry_msgs/Pose: position [m] and orientation."""

    position: Point
    orientation: Quaternion


@dataclass
@final
@autoid("sequential")
class PoseWithCovariance(IdlStruct, typename="geometry_msgs::msg::dds_::PoseWithCovariance_"):
    """geometry_msgs/PoseWithCovariance; `covariance` has `POSE_COVARIANCE_SIZE` numbers [m², m rad, rad²]."""

    pose: Pose
    covariance: Covariance


@dataclass
@final
@autoid("sequential")
class PoseWithCovarianceStamped(IdlStruct, typename="geometry_msgs::msg::dds_::PoseWithCovarianceStamped_"):
    """geometry_msgs/PoseWithCovarianceStamped."""

    header: Header
    pose: PoseWithCovariance


@dataclass
@final
@autoid("sequential")
class Transform(IdlStruct, typename="geometry_msgs::msg::dds_::Transform_"):
    """geometry_msgs/Transform: translation [m], then rotation, of the child frame in its parent."""

    translation: Vector3
    rotation: Quaternion


@dataclass
@final
@autoid("sequential")
class TransformStamped(IdlStruct, typename="geometry_msgs::msg::dds_::TransformStamped_"):
    """geometry_msgs/TransformStamped; `header.frame_id` is the parent frame."""

    header: Header
    child_frame_id: str
    transform: Transform


if TYPE_CHECKING:
    Transforms: TypeAlias = list[TransformStamped]
else:
    Transforms = types.sequence[TransformStamped]


@dataclass
@final
@autoid("sequential")
class TFMessage(IdlStruct, typename="tf2_msgs::msg::dds_::TFMessage_"):
    """tf2_msgs/TFMessage, of /tf and /tf_static."""

    transforms: Transforms


@dataclass
@final
@autoid("sequential")
class JointState(IdlStruct, typename="sensor_msgs::msg::dds_::JointState_"):
    """sensor_msgs/JointState: one entry a joint; empty where it is not stated; rad or m, per s, N m or N."""

    header: Header
    name: Names
    position: Doubles = field(default_factory=list)
    velocity: Doubles = field(default_factory=list)
    effort: Doubles = field(default_factory=list)
