"""Read recordings, also interrupted ones: the header, and captures and steps in order."""

from collections.abc import Container, Generator, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import msgspec
from mcap.records import Channel, Message, Metadata

from haptigraph.errors import BadInput
from haptigraph.messages import Capture, Step
from haptigraph.recording.codec import decode
from haptigraph.recording.foxglove import CompressedImage
from haptigraph.recording.journal import complete_records, is_being_written, is_whole, records_between
from haptigraph.recording.schema import READABLE, TOPICS, CaptureRecord, RunInfo
from haptigraph.recording.writer import METADATA

__all__ = ["RunReader", "StepLocation"]

VIEWER_TOPICS = ("/camera/annotations", "/log")
STEP_TOPICS = {"/capture", "/observation", "/graph", "/state", "/command"}  # of a complete step
DECODERS: dict[str, msgspec.json.Decoder[Any]] = {
    topic.name: msgspec.json.Decoder(topic.type) for topic in TOPICS if topic.name not in VIEWER_TOPICS
}
RENAMED_KEYS = (
    (b'"tip_deviation_mm":', b'"tip_sd_mm":'),
    (b'"theta_deviation_deg":', b'"theta_sd_deg":'),
)
"""Keys of /observation in format 1 and in the current format."""


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
        self.info = self._read_info()
        self.is_whole = is_whole(self.path)
        """False if the run was interrupted or is still being recorded."""
        self.is_being_written = not self.is_whole and is_being_written(self.path)

    def records(self, *, images: Container[int] | None = None) -> Generator[tuple[Capture, Step], None, None]:
        """Yield every capture with its step.

        Args:
            images: Numbers of the steps, from 0, whose images are decoded; None: all.

        Raises:
            BadInput: If a message cannot be decoded.
        """
        for place, messages in self._groups(images):
            if messages.keys() >= STEP_TOPICS:
                yield self._record(place.sequence, messages)

    def places(self) -> Generator[tuple[StepLocation, Step], None, None]:
        """Yield every step, without its image, and its location in the file.

        Raises:
            BadInput: If a message cannot be decoded.
        """
        for place, messages in self._groups(()):
            if messages.keys() >= STEP_TOPICS:
                yield place, self._record(place.sequence, messages)[1]

    def record_at(self, place: StepLocation) -> tuple[Capture, Step]:
        """Return the capture, with its image still encoded, and the step at a location.

        Raises:
            BadInput: If the file has changed.
        """
        for _, messages in self._groups(None, place):
            if messages.keys() >= STEP_TOPICS:
                return self._record(place.sequence, messages, decodes=False)
        raise BadInput("has changed; open the recording again", self.path, f"step {place.sequence}")

    def count(self) -> tuple[int, int]:
        """Count the steps, and the images that perception processed but the recorder dropped."""
        kept = [
            messages["/capture"].image for _, messages in self._groups(()) if messages.keys() >= STEP_TOPICS
        ]
        return len(kept), kept.count("dropped")

    def _record(
        self, sequence: int, messages: dict[str, Any], *, decodes: bool = True
    ) -> tuple[Capture, Step]:
        record: CaptureRecord = messages["/capture"]
        compressed: CompressedImage | None = messages.get("/camera/image")
        data = compressed.data if compressed else None
        try:
            image = decode(data) if data is not None and decodes else None
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
            wanted = topic != "/camera/image" or images is None or sequence in images
            if topic in DECODERS and wanted:
                messages[topic] = self._decoded(topic, record)
        if messages:
            yield StepLocation(sequence, start, last), messages

    def _decoded(self, topic: str, record: Message) -> Any:
        data = record.data
        if topic == "/observation":
            for old, new in RENAMED_KEYS:
                data = data.replace(old, new)
        try:
            return DECODERS[topic].decode(data)
        except msgspec.DecodeError as error:
            raise BadInput(f"{topic} cannot be read: {error}", self.path, f"step {record.sequence}") from None

    def _read_info(self) -> RunInfo:
        """Read the records before the first message: the header, and the topic of each channel."""
        info = None
        for _, record in complete_records(self.path):
            if isinstance(record, Metadata) and record.name == METADATA:
                info = self._info_in(record)
            elif isinstance(record, Channel):
                self._topics[record.id] = record.topic
            elif isinstance(record, Message):
                break
        if info is None:
            raise BadInput("not a recording of haptigraph (its header is missing)", self.path)
        return info

    def _info_in(self, record: Metadata) -> RunInfo:
        try:
            info = msgspec.convert(record.metadata, RunInfo, strict=False)
        except msgspec.ValidationError as error:
            raise BadInput(f"header cannot be read: {error}", self.path) from None
        if info.format not in READABLE:
            raise BadInput(
                f"recording format {info.format!r}; this version reads {', '.join(READABLE)}", self.path
            )
        return info
