"""The contents of a recording: the table of topics, and the header that makes it replayable.

A test keeps docs/reference/recordings.md consistent with this table.
"""

from typing import Any, Literal, NamedTuple, TypeAlias

from msgspec import UNSET, Struct, UnsetType

from haptigraph.graph import SceneGraph
from haptigraph.messages import (
    CameraStamp,
    Conclusion,
    Delivered,
    Fault,
    ForceSample,
    HandState,
    HapticCommand,
    Observation,
    RobotSample,
    Timing,
    Truth,
)
from haptigraph.recording.foxglove import (
    CompressedImage,
    ImageAnnotations,
    Log,
    PosesInFrame,
    foxglove_schema,
)

__all__ = [
    "FORMAT",
    "READABLE",
    "TOPICS",
    "UNCHECKED",
    "CaptureRecord",
    "DepthPlace",
    "Kept",
    "RunInfo",
    "Topic",
    "VideoImage",
    "mcap_schema",
]

FORMAT = "4"
UNCHECKED = ("1", "2")
"""Formats without a checksum of the header, and in a journal without any of the messages."""
READABLE = (*UNCHECKED, "3", FORMAT)
"""Format 1 names the standard deviations in /observation differently; `decoding` translates them. Up to
format 3, no recording contains a video."""

Kept: TypeAlias = Literal["recorded", "video", "dropped", "none"]


class RunInfo(Struct, frozen=True):
    """The header of a recording: everything that a replay needs besides the images."""

    version: str
    """Version of haptigraph that wrote the recording."""
    started_utc: str
    """Date and time of the first stamp, ISO 8601."""
    utc_offset_ns: int
    """Nanoseconds since 1970 minus stamp_ns."""
    source: str
    rate_hz: float
    config: str
    """The whole configuration, JSON."""
    registration: str
    """The complete registration file."""
    registration_sha256: str
    procedure: str
    """The complete procedure file."""
    procedure_sha256: str
    participant: str = ""
    trial: str = ""
    format: str = FORMAT
    decoder: str = ""
    """What decoded images during the run, if its recording was to contain a video."""
    robot_setup: str = ""
    """The complete robot.toml; empty: no robot, or not calibrated."""
    robot_setup_sha256: str = ""
    robot_shift: str = ""
    """How the robot's stamps were changed after the run, in one sentence; empty: they were not."""
    device_profile: str = ""
    """The complete profile of the haptic device; empty: none, so that amplitudes were its drive."""
    device_profile_sha256: str = ""
    depth_camera: str = ""
    """The camera that measured the depths, JSON (`DepthCamera`); empty: there are none."""
    own_classes: str = ""
    """Perceiver, source and device that are not part of haptigraph, a line each: "perceiver module:Class" and
    the SHA-256 of the module's file, if it has one; empty: none."""


class VideoImage(Struct, frozen=True):
    """An image of the video that the recording contains."""

    number: int
    """In the video, from 0."""
    crc32: int
    """CRC-32 of its pixels, rows from the top, BGR or grey."""


class DepthPlace(Struct, frozen=True):
    """What /camera/depth shows of an image, and in which unit."""

    unit_mm: float
    left_px: int
    top_px: int


class CaptureRecord(Struct, frozen=True):
    """A capture without its image."""

    index: int
    stamp_ns: int
    image: Kept
    """Recorded: in /camera/image. Video: in the attached video. Dropped: perception processed an image that
    the recorder had no time to write."""
    faults: tuple[Fault, ...] = ()
    truth: Truth | None = None
    camera: CameraStamp | None = None
    phase: str = ""
    phase_s: float = 0.0
    video: VideoImage | None = None
    """Which image of the video it is."""
    delivered: tuple[Delivered, ...] | UnsetType = UNSET
    """Vibration that an output confirmed; left out where there was none."""
    robot: tuple[RobotSample, ...] | UnsetType = UNSET
    """Measurements of the robot; left out where there were none."""
    force: tuple[ForceSample, ...] | UnsetType = UNSET
    """What the force device did; left out where there was none."""
    depth: DepthPlace | UnsetType = UNSET
    """Of the depths in /camera/depth; left out where there were none, or the image was dropped."""


class Topic(NamedTuple):
    """One row of the table."""

    name: str
    type: type
    schema: str
    unit: str
    """Units of its numbers."""
    says: str
    """What it contains."""


TOPICS = (
    Topic(
        "/camera/image",
        CompressedImage,
        "foxglove.CompressedImage",
        "px",
        "the JPEG or PNG bytes that perception consumed; none for images of a stored video",
    ),
    Topic(
        "/camera/annotations",
        ImageAnnotations,
        "foxglove.ImageAnnotations",
        "px",
        "the detected geometry, drawn for viewers",
    ),
    Topic(
        "/capture",
        CaptureRecord,
        "haptigraph.Capture",
        "ns, px, mm, deg, s, N",
        "stamp, the camera's own stamp, external faults, the simulator's ground truth, phase, "
        "which image of the stored video, vibration that an output confirmed, the robot's measurements, "
        "the force on the hand",
    ),
    Topic(
        "/teleop",
        HandState,
        "haptigraph.HandState",
        "mm",
        "motion of the operator's hand, motion requested of the tool, settings",
    ),
    Topic(
        "/observation",
        Observation,
        "haptigraph.Observation",
        "ns, mm",
        "geometry of the detected entities, eye frame",
    ),
    Topic(
        "/graph",
        SceneGraph,
        "haptigraph.SceneGraph",
        "ns, mm, deg",
        "nodes, edges, measures, standard deviations",
    ),
    Topic("/state", Conclusion, "haptigraph.Conclusion", "ns", "surgical state and why"),
    Topic("/command", HapticCommand, "haptigraph.HapticCommand", "ns, ms, Hz", "the haptic output"),
    Topic("/timing", Timing, "haptigraph.Timing", "ns", "processed and commanded stamps, stage durations"),
    Topic(
        "/robot/poses",
        PosesInFrame,
        "foxglove.PosesInFrame",
        "m",
        "the robot's poses in its base, for viewers",
    ),
    Topic("/log", Log, "foxglove.Log", "", "faults, for viewers"),
    Topic(
        "/camera/depth",
        CompressedImage,
        "foxglove.CompressedImage",
        "",
        "the depths that perception consumed, as PNG of 16 bits; `/capture` has unit and position",
    ),
)


def mcap_schema(topic: Topic, measures: tuple[str, ...]) -> dict[str, Any]:
    """Return the JSON schema stored with a topic; a graph's lists the measures by name, for plotting."""
    schema = foxglove_schema(topic.type, topic.schema)
    if topic.type is SceneGraph:
        schema["properties"]["measures"]["properties"] = {name: {"type": "number"} for name in measures}
    return schema
