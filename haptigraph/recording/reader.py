"""Read recordings, also interrupted ones: the header, and captures and steps in order."""

from collections.abc import Container, Generator, Iterator
from pathlib import Path
from typing import Any, NamedTuple

from mcap.records import Channel, Message, Metadata
from msgspec.structs import replace

from haptigraph.errors import BadInput
from haptigraph.messages import Capture, Image, Step
from haptigraph.recording.attachments import AttachedFile
from haptigraph.recording.codec import decode
from haptigraph.recording.decoding import IMAGE, decode_message, is_complete, is_read
from haptigraph.recording.foxglove import CompressedImage
from haptigraph.recording.header import Losses, is_header, is_losses, read_header, read_losses
from haptigraph.recording.journal import complete_records, is_being_written, is_whole, records_between
from haptigraph.recording.schema import CaptureRecord, RunInfo
from haptigraph.recording.stored_video import StoredVideo

__all__ = ["RunReader", "StepLocation"]


class StepLocation(NamedTuple):
    """Location of a step in a file, for random access."""

    sequence: int
    start: int
    """Byte offset of the record, or the chunk, with its first message."""
    end: int


class RunReader:
    """One recording.

    Args:
        path: The MCAP file.

    Raises:
        BadInput: If it cannot be read or is not a recording of haptigraph.
    """

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        self._topics: dict[int, str] = {}
        self.losses: Losses | None = None
        """What is missing, if it was recovered from a damaged recording."""
        self.differing_images = 0
        """Images, of those decoded so far, that have other pixels than during the run: another decoder."""
        self.dropped_images = 0
        """Images, of the steps read so far, that perception processed but the recording lacks."""
        self._video: StoredVideo | None = None
        self.info = self._read_info()
        self.is_whole = is_whole(self.path)
        """False if the run was interrupted or is still being recorded."""
        self.is_being_written = not self.is_whole and is_being_written(self.path)

    def records(self, *, images: Container[int] | None = None) -> Generator[tuple[Capture, Step], None, None]:
        """Yield every capture with its step.

        Args:
            images: Numbers of the steps, from 0, whose images are decoded; None: all.

        Raises:
            BadInput: If the file is damaged, or a message cannot be decoded.
        """
        for place, messages in self._steps(images):
            yield self._record(place.sequence, messages, decodes=images is None or place.sequence in images)

    def places(self) -> Generator[tuple[StepLocation, Step], None, None]:
        """Yield every step, without its image, and its location in the file.

        Raises:
            BadInput: If the file is damaged, or a message cannot be decoded.
        """
        for place, messages in self._steps(()):
            yield place, self._record(place.sequence, messages, decodes=False)[1]

    def record_at(self, place: StepLocation) -> tuple[Capture, Step]:
        """Return the capture and the step at a location; an image that was stored alone is still encoded.

        Raises:
            BadInput: If the file has changed.
        """
        for _, messages in self._groups(None, place):
            if is_complete(messages):
                capture, step = self._record(place.sequence, messages, decodes=False)
                return replace(capture, image=self._video_image(place.sequence, messages["/capture"])), step
        raise BadInput("has changed; open the recording again", self.path, f"step {place.sequence}")

    def count(self) -> tuple[int, int]:
        """Count the steps, and the images that perception processed but the recording lacks.

        Raises:
            BadInput: If the file is damaged, or a message cannot be decoded.
        """
        dropped = [self._is_dropped(messages["/capture"]) for _, messages in self._steps(())]
        return len(dropped), sum(dropped)

    def _is_dropped(self, record: CaptureRecord) -> bool:
        return record.image == "dropped" or (record.image == "video" and self._video is None)

    def _record(self, sequence: int, messages: dict[str, Any], *, decodes: bool) -> tuple[Capture, Step]:
        record: CaptureRecord = messages["/capture"]
        compressed: CompressedImage | None = messages.get(IMAGE)
        data = compressed.data if compressed else None
        self.dropped_images += self._is_dropped(record)
        try:
            image = decode(data) if data is not None and decodes else None
            if decodes and record.video is not None:
                image = self._video_image(sequence, record)
        except ValueError as error:
            raise BadInput(f"image cannot be decoded: {error}", self.path, f"step {sequence}") from None
        capture = Capture(
            record.index,
            record.stamp_ns,
            image,
            data,
            record.faults,
            record.truth,
            messages.get("/teleop"),
            record.camera,
            record.phase,
            record.phase_s,
            record.delivered or (),
            record.robot or (),
            record.force or (),
        )
        step = Step(
            record.index,
            record.stamp_ns,
            messages["/observation"],
            messages["/graph"],
            messages["/state"],
            messages["/command"],
            messages.get("/timing"),
        )
        return capture, step

    def _video_image(self, sequence: int, record: CaptureRecord) -> Image | None:
        if self._video is None or record.video is None:
            return None
        try:
            image, is_same = self._video.image(record.video.number, record.video.crc32)
        except ValueError as error:
            raise BadInput(f"image cannot be decoded: {error}", self.path, f"step {sequence}") from None
        self.differing_images += not is_same
        return image

    def _steps(self, images: Container[int] | None) -> Iterator[tuple[StepLocation, dict[str, Any]]]:
        """Yield the messages of every step; only the last of an interrupted run may be incomplete."""
        expected, incomplete = 0, None
        for place, messages in self._groups(images):
            if incomplete is not None:
                raise BadInput("damaged (a step is incomplete)", self.path, f"step {incomplete}")
            if place.sequence != expected and self.losses is None:
                found = f"step {place.sequence} follows instead of {expected}"
                raise BadInput(f"damaged ({found})", self.path, f"byte {place.start}")
            expected = place.sequence + 1
            if is_complete(messages):
                if messages["/capture"].video and self._video is None and self.losses is None:
                    raise BadInput("damaged (the video of its images is missing)", self.path)
                yield place, messages
            else:
                incomplete = place.sequence

    def _groups(
        self, images: Container[int] | None, place: StepLocation | None = None
    ) -> Iterator[tuple[StepLocation, dict[str, Any]]]:
        """Group the messages of each step, or of one; they are consecutive and share a sequence number."""
        sequence, messages = -1, dict[str, Any]()
        start = last = before = offset = 0
        records = records_between(self.path, *place[1:]) if place else complete_records(self.path)
        for end, record in records:
            if end != offset:
                before, offset = offset, end
            if isinstance(record, Channel):
                self._topics[record.id] = record.topic
            if not isinstance(record, Message) or (place and record.sequence != place.sequence):
                continue
            topic = self._topics.get(record.channel_id, "")
            if record.sequence != sequence:
                if messages:
                    yield StepLocation(sequence, start, last), messages
                sequence, messages, start = record.sequence, {}, before
            last = end
            if topic == IMAGE and images is not None and sequence not in images:
                messages[topic] = None
            elif is_read(topic) or not topic:
                messages[topic] = decode_message(topic, record, self.path)
        if messages:
            yield StepLocation(sequence, start, last), messages

    def _read_info(self) -> RunInfo:
        """Read the records before the first message: header, topic of each channel, place of the video."""
        info = None
        for _, record in complete_records(self.path, verifies_attachments=False):
            if isinstance(record, Metadata) and is_header(record):
                info = read_header(record, self.path)
            elif isinstance(record, Metadata) and is_losses(record):
                self.losses = read_losses(record, self.path)
            elif isinstance(record, Channel):
                self._topics[record.id] = record.topic
            elif isinstance(record, AttachedFile):
                self._video = StoredVideo(record)
            elif isinstance(record, Message):
                break
        if info is None:
            raise BadInput("not a recording of haptigraph (its header is missing)", self.path)
        return info
