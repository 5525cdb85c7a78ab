"""The ROS 2 messages that command and supervise robots, as DDS types with the fields of ROS's .msg files."""

from dataclasses import dataclass, field

from cyclonedds.idl import IdlStruct, types
from cyclonedds.idl.annotations import autoid, final

from haptigraph.ros2.geometry_types import Pose, Vector3
from haptigraph.ros2.types import Header

__all__ = [
    "OperatingState",
    "PoseStamped",
    "ServoCommandTypeReply",
    "ServoCommandTypeRequest",
    "ServoStatus",
    "SetBoolReply",
    "SetBoolRequest",
    "StringStamped",
    "Twist",
    "TwistStamped",
    "Wrench",
    "WrenchStamped",
]


@dataclass
@final
@autoid("sequential")
class PoseStamped(IdlStruct, typename="geometry_msgs::msg::dds_::PoseStamped_"):
    """geometry_msgs/PoseStamped; `header.frame_id` is the frame of reference."""

    header: Header
    pose: Pose


@dataclass
@final
@autoid("sequential")
class Twist(IdlStruct, typename="geometry_msgs::msg::dds_::Twist_"):
    """geometry_msgs/Twist: velocity [m/s] and angular velocity [rad/s]."""

    linear: Vector3 = field(default_factory=Vector3)
    angular: Vector3 = field(default_factory=Vector3)


@dataclass
@final
@autoid("sequential")
class TwistStamped(IdlStruct, typename="geometry_msgs::msg::dds_::TwistStamped_"):
    """geometry_msgs/TwistStamped."""

    header: Header
    twist: Twist


@dataclass
@final
@autoid("sequential")
class Wrench(IdlStruct, typename="geometry_msgs::msg::dds_::Wrench_"):
    """geometry_msgs/Wrench: force [N] and torque [N m]."""

    force: Vector3 = field(default_factory=Vector3)
    torque: Vector3 = field(default_factory=Vector3)


@dataclass
@final
@autoid("sequential")
class WrenchStamped(IdlStruct, typename="geometry_msgs::msg::dds_::WrenchStamped_"):
    """geometry_msgs/WrenchStamped."""

    header: Header
    wrench: Wrench


@dataclass
@final
@autoid("sequential")
class OperatingState(IdlStruct, typename="crtk_msgs::msg::dds_::OperatingState_"):
    """crtk_msgs/OperatingState; `state` is DISABLED, ENABLED, PAUSED or FAULT."""

    header: Header
    state: str
    is_homed: bool
    is_busy: bool


@dataclass
@final
@autoid("sequential")
class StringStamped(IdlStruct, typename="crtk_msgs::msg::dds_::StringStamped_"):
    """crtk_msgs/StringStamped."""

    header: Header
    string: str


@dataclass
@final
@autoid("sequential")
class ServoStatus(IdlStruct, typename="moveit_msgs::msg::dds_::ServoStatus_"):
    """moveit_msgs/ServoStatus; `code` is -1 (invalid) to 6, 0 without a warning."""

    code: types.int8
    message: str


@dataclass
@final
@autoid("sequential")
class ServoCommandTypeRequest(IdlStruct, typename="moveit_msgs::srv::dds_::ServoCommandType_Request_"):
    """Request of moveit_msgs/ServoCommandType: 0 joints, 1 twist, 2 pose."""

    command_type: types.int8 = 0


@dataclass
@final
@autoid("sequential")
class ServoCommandTypeReply(IdlStruct, typename="moveit_msgs::srv::dds_::ServoCommandType_Response_"):
    """Reply of moveit_msgs/ServoCommandType."""

    success: bool = False


@dataclass
@final
@autoid("sequential")
class SetBoolRequest(IdlStruct, typename="std_srvs::srv::dds_::SetBool_Request_"):
    """Request of std_srvs/SetBool."""

    data: bool = False


@dataclass
@final
@autoid("sequential")
class SetBoolReply(IdlStruct, typename="std_srvs::srv::dds_::SetBool_Response_"):
    """Reply of std_srvs/SetBool."""

    success: bool = False
    message: str = ""
