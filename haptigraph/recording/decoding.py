"""Turn the messages of a recording back into structs, also those of earlier formats."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import msgspec
from mcap.records import Message
from msgspec import UNSET

from haptigraph.errors import BadInput
from haptigraph.messages import DepthImage
from haptigraph.recording.codec import decode_depth
from haptigraph.recording.schema import TOPICS, CaptureRecord

__all__ = ["DEPTH", "IMAGE", "decode_message", "depth_of", "is_complete", "is_read"]

IMAGE = "/camera/image"
DEPTH = "/camera/depth"
VIEWER_TOPICS = ("/camera/annotations", "/log", "/robot/poses")
STEP_TOPICS = {"/capture", "/observation", "/graph", "/state", "/command"}  # of a complete step
DECODERS: dict[str, msgspec.json.Decoder[Any]] = {
    topic.name: msgspec.json.Decoder(dict[str, msgspec.Raw] if topic.name in VIEWER_TOPICS else topic.type)
    for topic in TOPICS
}
RENAMED_KEYS = (
    (b'"tip_deviation_mm":', b'"tip_sd_mm":'),
    (b'"theta_deviation_deg":', b'"theta_sd_deg":'),
)
"""Keys of /observation in format 1 and in the current format."""


def is_read(topic: str) -> bool:
    """Return whether a topic is part of a step; the others are for viewers."""
    return topic in DECODERS and topic not in VIEWER_TOPICS


def decode_message(topic: str, record: Message, path: Path) -> Any:
    """Decode one message.

    Raises:
        BadInput: If that is impossible; `path` names the recording.
    """
    data, where = record.data, f"step {record.sequence}"
    if topic not in DECODERS:
        raise BadInput(f"damaged (a message of an unknown topic {topic!r})", path, where)
    if topic == "/observation":
        for old, new in RENAMED_KEYS:
            data = data.replace(old, new)
    try:
        return DECODERS[topic].decode(data)
    except (msgspec.DecodeError, UnicodeDecodeError) as error:
        raise BadInput(f"{topic} cannot be read: {error}", path, where) from None


def is_complete(messages: Mapping[str, Any]) -> bool:
    """Return whether all messages of a step are there, by topic; an image that was not wanted is None."""
    if not messages.keys() >= STEP_TOPICS:
        return False
    capture: CaptureRecord = messages["/capture"]
    has_image = capture.image != "recorded" or IMAGE in messages
    return has_image and (capture.depth is UNSET or DEPTH in messages)


def depth_of(record: CaptureRecord, messages: Mapping[str, Any]) -> DepthImage | None:
    """Return the depth image of a step from its messages by topic; None: it has none.

    Raises:
        ValueError: If it cannot be decoded.
    """
    if record.depth is UNSET:
        return None
    place, values = record.depth, decode_depth(messages[DEPTH].data)
    return DepthImage(values, place.unit_mm, place.left_px, place.top_px)
