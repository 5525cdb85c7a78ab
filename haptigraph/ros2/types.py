"""The ROS 2 messages that haptigraph exchanges, as DDS types with the fields of ROS's .msg files.

ROS 2's own middlewares map `pkg/msg/X` to the DDS type `pkg::msg::dds_::X_`, final and with sequential member
ids (https://design.ros2.org/articles/topic_and_service_names.html).
"""

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, TypeAlias

from cyclonedds.idl import IdlStruct, types
from cyclonedds.idl._machinery import BytesMachine
from cyclonedds.idl.annotations import autoid, final

__all__ = [
    "RUMBLE",
    "CompressedImage",
    "DiagnosticArray",
    "DiagnosticStatus",
    "Header",
    "Image",
    "Joy",
    "JoyFeedback",
    "KeyValue",
    "Point",
    "PointStamped",
    "String",
    "Time",
]

RUMBLE = 1
"""JoyFeedback.TYPE_RUMBLE."""

if TYPE_CHECKING:
    Bytes: TypeAlias = bytes
    Floats: TypeAlias = list[float]
    Ints: TypeAlias = list[int]
else:
    Bytes, Floats, Ints = (types.sequence[kind] for kind in (types.uint8, types.float32, types.int32))


@dataclass
@final
@autoid("sequential")
class Time(IdlStruct, typename="builtin_interfaces::msg::dds_::Time_"):
    """builtin_interfaces/Time: wall-clock time."""

    sec: types.int32 = 0
    nanosec: types.uint32 = 0

    @classmethod
    def from_ns(cls, utc_ns: int) -> "Time":
        """Split nanoseconds since 1970."""
        return cls(*divmod(utc_ns, 1_000_000_000))

    @property
    def ns(self) -> int:
        """Nanoseconds since 1970."""
        return self.sec * 1_000_000_000 + self.nanosec


@dataclass
@final
@autoid("sequential")
class Header(IdlStruct, typename="std_msgs::msg::dds_::Header_"):
    """std_msgs/Header: time stamp and coordinate frame."""

    stamp: Time = field(default_factory=Time)
    frame_id: str = ""


@dataclass
@final
@autoid("sequential")
class String(IdlStruct, typename="std_msgs::msg::dds_::String_"):
    """std_msgs/String."""

    data: str


@dataclass
@final
@autoid("sequential")
class Point(IdlStruct, typename="geometry_msgs::msg::dds_::Point_"):
    """geometry_msgs/Point [m]."""

    x: types.float64
    y: types.float64
    z: types.float64


@dataclass
@final
@autoid("sequential")
class PointStamped(IdlStruct, typename="geometry_msgs::msg::dds_::PointStamped_"):
    """geometry_msgs/PointStamped."""

    header: Header
    point: Point


@dataclass
@final
@autoid("sequential")
class Joy(IdlStruct, typename="sensor_msgs::msg::dds_::Joy_"):
    """sensor_msgs/Joy: axes in [-1, 1], buttons 0 or 1."""

    header: Header
    axes: Floats
    buttons: Ints


@dataclass
@final
@autoid("sequential")
class JoyFeedback(IdlStruct, typename="sensor_msgs::msg::dds_::JoyFeedback_"):
    """sensor_msgs/JoyFeedback; type 1 is rumble, intensity in [0, 1]."""

    type: types.uint8
    id: types.uint8
    intensity: types.float32


@dataclass
@final
@autoid("sequential")
class Image(IdlStruct, typename="sensor_msgs::msg::dds_::Image_"):
    """sensor_msgs/Image: rows of `step` bytes."""

    header: Header
    height: types.uint32
    width: types.uint32
    encoding: str
    is_bigendian: types.uint8
    step: types.uint32
    data: Bytes


@dataclass
@final
@autoid("sequential")
class CompressedImage(IdlStruct, typename="sensor_msgs::msg::dds_::CompressedImage_"):
    """sensor_msgs/CompressedImage: the bytes of a JPEG or PNG file."""

    header: Header
    format: str
    data: Bytes


@dataclass
@final
@autoid("sequential")
class KeyValue(IdlStruct, typename="diagnostic_msgs::msg::dds_::KeyValue_"):
    """diagnostic_msgs/KeyValue."""

    key: str
    value: str


if TYPE_CHECKING:
    KeyValues: TypeAlias = list[KeyValue]
else:
    KeyValues = types.sequence[KeyValue]


@dataclass
@final
@autoid("sequential")
class DiagnosticStatus(IdlStruct, typename="diagnostic_msgs::msg::dds_::DiagnosticStatus_"):
    """diagnostic_msgs/DiagnosticStatus; level 0 is OK, 1 a warning, 2 an error, 3 stale."""

    level: types.byte
    name: str
    message: str
    hardware_id: str
    values: KeyValues


if TYPE_CHECKING:
    Statuses: TypeAlias = list[DiagnosticStatus]
else:
    Statuses = types.sequence[DiagnosticStatus]


@dataclass
@final
@autoid("sequential")
class DiagnosticArray(IdlStruct, typename="diagnostic_msgs::msg::dds_::DiagnosticArray_"):
    """diagnostic_msgs/DiagnosticArray."""

    header: Header
    status: Statuses


def _keep_bytes(image_type: type[IdlStruct]) -> None:
    """Make `data` bytes; cyclonedds' default, a list of numbers, takes 100 ms for one image."""
    idl = image_type.__idl__
    idl.populate()
    for machine in (idl.v1_machine, idl.v2_machine):
        machine.members_machines["data"] = BytesMachine()


_keep_bytes(Image)
_keep_bytes(CompressedImage)
