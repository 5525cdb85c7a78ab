"""Replace the video in a recording by the images that were used, where they are few."""

from collections.abc import Iterable, Iterator
from dataclasses import replace

import msgspec
from mcap.records import Channel, McapRecord, Message

from haptigraph.errors import BadInput
from haptigraph.recording.attachments import AttachedFile
from haptigraph.recording.codec import encode_png
from haptigraph.recording.decoding import IMAGE, decode_message
from haptigraph.recording.foxglove import CompressedImage, Time, encode_message
from haptigraph.recording.schema import CaptureRecord, VideoImage
from haptigraph.recording.stored_video import StoredVideo

__all__ = ["unpacked"]


def unpacked(records: Iterable[McapRecord]) -> Iterator[McapRecord]:
    """Yield the records of a recording with its images as PNG, instead of its video.

    Raises:
        BadInput: If an image cannot be decoded as it was during the run.
    """
    video: StoredVideo | None = None
    channels: dict[str, int] = {}
    for record in records:
        if isinstance(record, AttachedFile):
            video = StoredVideo(record)
            continue
        if isinstance(record, Channel):
            channels[record.topic] = record.id
        if video is None or not isinstance(record, Message) or record.channel_id != channels["/capture"]:
            yield record
            continue
        capture: CaptureRecord = decode_message("/capture", record, video.file.path)
        if capture.video is None:
            yield record
            continue
        alone = msgspec.structs.replace(capture, image="recorded", video=None)
        yield replace(record, data=encode_message(alone))
        image = CompressedImage(Time.from_ns(record.log_time), "camera", _png(video, capture.video), "png")
        yield replace(record, channel_id=channels[IMAGE], data=encode_message(image))


def _png(video: StoredVideo, place: VideoImage) -> bytes:
    try:
        image, is_same = video.image(place.number, place.crc32)
    except ValueError as error:
        raise BadInput(str(error), video.file.path) from None
    if not is_same:
        raise BadInput(f"image {place.number} of its video has changed", video.file.path)
    return encode_png(image)
