"""Turn one step into the messages of the table in `schema`, for recordings and live viewers."""

from collections.abc import Iterator

from msgspec import UNSET, Struct

from haptigraph.messages import Capture, Step
from haptigraph.projection import ImageGeometry
from haptigraph.recording.codec import encode_depth, encode_png, format_of
from haptigraph.recording.foxglove import INFO, WARNING, CompressedImage, Log, Time, annotations, robot_poses
from haptigraph.recording.schema import CaptureRecord, DepthPlace, Kept, VideoImage

__all__ = ["entries"]


def entries(
    capture: Capture,
    step: Step,
    *,
    image: ImageGeometry,
    utc_offset_ns: int,
    dropped: bool = False,
    video: VideoImage | None = None,
) -> Iterator[tuple[str, Struct]]:
    """Yield topics and messages in the order of writing.

    Args:
        capture: The capture of the step.
        step: The step.
        image: Transformation between images and eye frame, for the annotations.
        utc_offset_ns: Nanoseconds since 1970 minus stamp_ns.
        dropped: True if there was an image that is not recorded.
        video: Which image of the recording's video it is, if it is one.
    """
    time = Time.from_ns(step.stamp_ns + utc_offset_ns)
    kept: Kept = "dropped" if dropped else "none" if capture.image is None else "recorded"
    if kept == "recorded" and video is not None:
        kept = "video"
    depth = capture.depth if kept in ("recorded", "video") else None
    record = CaptureRecord(
        capture.index,
        capture.stamp_ns,
        kept,
        capture.faults,
        capture.truth,
        capture.camera,
        capture.phase,
        capture.phase_s,
        video,
        capture.delivered or UNSET,
        capture.robot or UNSET,
        capture.force or UNSET,
        DepthPlace(depth.unit_mm, depth.left_px, depth.top_px) if depth else UNSET,
    )
    yield "/capture", record
    if capture.hand is not None:
        yield "/teleop", capture.hand
    if kept == "recorded":
        yield "/camera/image", _compressed(time, capture)
    if depth is not None:
        yield "/camera/depth", CompressedImage(time, "camera", encode_depth(depth.values), "png")
    yield "/camera/annotations", annotations(time, step.observation.found, image, step.conclusion.state)
    yield "/observation", step.observation
    yield "/graph", step.graph
    yield "/state", step.conclusion
    yield "/command", step.command
    if capture.robot:
        yield "/robot/poses", robot_poses(capture.robot, utc_offset_ns)
    for fault in step.observation.faults:
        yield "/log", Log(time, INFO if fault.is_over else WARNING, fault.message, fault.where)
    if step.timing is not None:  # last, so that its presence marks a complete step
        yield "/timing", step.timing


def _compressed(time: Time, capture: Capture) -> CompressedImage:
    if capture.encoded is not None:
        return CompressedImage(time, "camera", capture.encoded, format_of(capture.encoded))
    if capture.image is None:
        raise ValueError("the capture has no image to compress")
    return CompressedImage(time, "camera", encode_png(capture.image), "png")
