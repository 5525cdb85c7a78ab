"""Read recordings, also interrupted ones: the header, captures and steps, in order, by number or by time."""

from collections.abc import Container, Generator, Iterator, Sequence
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple, Self, overload

from mcap.records import Channel, Message, Metadata
from msgspec.structs import replace

from haptigraph.by_time import ByTime
from haptigraph.display import ShownRun
from haptigraph.errors import BadInput
from haptigraph.messages import Capture, Image, Step
from haptigraph.recording.attachments import AttachedFile
from haptigraph.recording.codec import decode
from haptigraph.recording.decoding import DEPTH, IMAGE, decode_message, depth_of, is_complete, is_read
from haptigraph.recording.foxglove import CompressedImage
from haptigraph.recording.header import Losses, is_header, is_losses, losses_at_end, read_header, read_losses
from haptigraph.recording.journal import complete_records, is_being_written, is_whole, records_between
from haptigraph.recording.schema import CaptureRecord, RunInfo
from haptigraph.recording.stored_video import StoredVideo, video_at_the_end

__all__ = ["RunReader", "StepLocation"]


class StepLocation(NamedTuple):
    """Location of a step in a file, for random access."""

    sequence: int
    start: int
    """Byte offset of the record, or the chunk, with its first message."""
    end: int


class _Index(NamedTuple):
    places: list[StepLocation]
    time_s: list[float]
    """Since the first step."""


class RunReader(ShownRun):
    """One recording, also as the sequence of its complete steps.

    `len(run)`, `for step in run`, `run[10]`, `run[-1]`, `run[10:20]`: steps by number, without images;
    `run.at_s[2.5]`, `run.at_s[2.5:4]`: by time. Of a recording that is still being written, `for` reads what
    there is; the others know the steps there were when one was first asked for. `with RunReader(path) as run`
    closes a stored video.

    Args:
        path: The MCAP file.

    Raises:
        BadInput: If it cannot be read or is not a recording of haptigraph.
    """

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        self._topics: dict[int, str] = {}
        self.losses: Losses | None = None
        """What is missing: if it was recovered from a damaged recording, or the recorder failed."""
        self.differing_images = 0
        """Images, of those decoded so far, that have other pixels than during the run: another decoder."""
        self.dropped_images = 0
        """Images, of those asked for so far, that perception processed but the recording lacks."""
        self._video: StoredVideo | None = None
        self.info = self._read_info()
        self.is_whole = is_whole(self.path)
        """False if the run was interrupted or is still being recorded."""
        if self.is_whole and self.info.decoder and self._video is None:
            self._video = video_at_the_end(self.path)
        self.is_being_written = not self.is_whole and is_being_written(self.path)
        self.losses = self.losses or (None if self.is_whole else losses_at_end(self.path))

    def __repr__(self) -> str:
        started = self.info.started_utc[:16].replace("T", " ")
        return f"<RunReader {self.path.name}: {self.info.source}, {started} UTC>"

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close what reading images has opened. May be called twice; reading opens it again."""
        if self._video is not None:
            self._video.close()

    def __len__(self) -> int:
        return len(self._index.places)

    def __iter__(self) -> Iterator[Step]:
        return (step for _, step in self.places())

    @overload
    def __getitem__(self, number: int) -> Step: ...

    @overload
    def __getitem__(self, number: slice) -> list[Step]: ...

    def __getitem__(self, number: int | slice) -> Step | list[Step]:
        if not isinstance(number, slice):
            return self._steps_at([self._place(number)])[0]
        places = self._index.places[number]
        backwards = number.step is not None and number.step < 0
        return self._steps_at(places[::-1])[::-1] if backwards else self._steps_at(places)

    @property
    def at_s(self) -> ByTime[Step]:
        """Steps by time in seconds since the first step: `run.at_s[2.5]`, `run.at_s[2.5:4]`."""
        return ByTime(self, self._index.time_s)

    def capture(self, number: int) -> Capture:
        """Return the capture of a step, with its image.

        Raises:
            IndexError: If there is no such step.
            BadInput: If the image cannot be decoded.
        """
        place = self._place(number)
        return self._record(place.sequence, self._messages_at(place), decodes=True)[0]

    def records(self, *, images: Container[int] | None = None) -> Generator[tuple[Capture, Step], None, None]:
        """Yield every capture with its step.

        Args:
            images: Numbers of the steps, from 0, whose images are decoded; None: all.

        Raises:
            BadInput: If the file is damaged, or a message cannot be decoded.
        """
        for _, capture, step in self.numbered_records(images=images):
            yield capture, step

    def numbered_records(
        self, *, images: Container[int] | None = None
    ) -> Generator[tuple[int, Capture, Step], None, None]:
        """Yield the number of every step in the recording, its capture and the step, as `records` does."""
        for place, messages in self._steps(images):
            decodes = images is None or place.sequence in images
            yield place.sequence, *self._record(place.sequence, messages, decodes=decodes)

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
        messages = self._messages_at(place)
        capture, step = self._record(place.sequence, messages, decodes=False)
        return replace(capture, image=self._video_image(place.sequence, messages["/capture"])), step

    def count(self) -> tuple[int, int]:
        """Count the steps, and the images that perception processed but the recording lacks.

        Raises:
            BadInput: If the file is damaged, or a message cannot be decoded.
        """
        dropped = [self._is_dropped(messages["/capture"]) for _, messages in self._steps(())]
        return len(dropped), sum(dropped)

    def _is_dropped(self, record: CaptureRecord) -> bool:
        return record.image == "dropped" or (record.image == "video" and self._video is None)

    @cached_property
    def _index(self) -> _Index:
        places, stamps_ns = list[StepLocation](), list[int]()
        for place, step in self.places():
            places.append(place)
            stamps_ns.append(step.stamp_ns)
        return _Index(places, [(stamp_ns - stamps_ns[0]) / 1e9 for stamp_ns in stamps_ns])

    def _place(self, number: int) -> StepLocation:
        count = len(self)
        if not -count <= number < count:
            raise IndexError(f"{self.path.name} has no step {number}; valid: 0 to {count - 1}")
        return self._index.places[number]

    def _steps_at(self, places: list[StepLocation]) -> list[Step]:
        """Return the steps at some locations, in order, in one pass."""
        found = self._complete((), places) if places else []
        return [self._record(place.sequence, messages, decodes=False)[1] for place, messages in found]

    def _messages_at(self, place: StepLocation) -> dict[str, Any]:
        return next(self._complete(None, [place]))[1]

    def _complete(
        self, images: Container[int] | None, places: Sequence[StepLocation]
    ) -> Iterator[tuple[StepLocation, dict[str, Any]]]:
        """Yield the messages of the steps at some locations; fail in the end if one was not there."""
        missing = len(places)
        for place, messages in self._groups(images, places):
            if is_complete(messages):
                missing -= 1
                yield place, messages
        if missing > 0:
            where = f"step {places[0].sequence}"
            raise BadInput("has changed; open the recording again", self.path, where)

    def _record(self, sequence: int, messages: dict[str, Any], *, decodes: bool) -> tuple[Capture, Step]:
        record: CaptureRecord = messages["/capture"]
        compressed: CompressedImage | None = messages.get(IMAGE)
        data = compressed.data if compressed else None
        self.dropped_images += decodes and self._is_dropped(record)
        try:
            image = decode(data) if data is not None and decodes else None
            if decodes and record.video is not None:
                image = self._video_image(sequence, record)
            depth = depth_of(record, messages) if decodes else None
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
            depth,
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
                    saves = "`haptigraph recover` saves what can be read"
                    raise BadInput(f"damaged (the video of its images is missing); {saves}", self.path)
                yield place, messages
            else:
                incomplete = place.sequence

    def _groups(
        self, images: Container[int] | None, places: Sequence[StepLocation] = ()
    ) -> Iterator[tuple[StepLocation, dict[str, Any]]]:
        """Group the messages of each step, or of those at some locations, in order.

        They are consecutive and share a sequence number.
        """
        sequence, messages = -1, dict[str, Any]()
        start = end_of_step = 0
        for before, end, message in self._messages(places):
            topic = self._topics.get(message.channel_id, "")
            if message.sequence != sequence:
                if messages:
                    yield StepLocation(sequence, start, end_of_step), messages
                sequence, messages, start = message.sequence, {}, before
            end_of_step = end
            if topic in (IMAGE, DEPTH) and images is not None and sequence not in images:
                messages[topic] = None
            elif is_read(topic) or not topic:
                messages[topic] = decode_message(topic, message, self.path)
        if messages:
            yield StepLocation(sequence, start, end_of_step), messages

    def _messages(self, places: Sequence[StepLocation]) -> Iterator[tuple[int, int, Message]]:
        """Yield all messages, or those of some steps, after where their record or chunk starts and ends."""
        before = offset = 0
        records, wanted = complete_records(self.path), {place.sequence for place in places}
        if places:
            records = records_between(self.path, places[0].start, places[-1].end)
        for end, record in records:
            if end != offset:
                before, offset = offset, end
            if isinstance(record, Channel):
                self._topics[record.id] = record.topic
            elif isinstance(record, Message) and (not places or record.sequence in wanted):
                yield before, end, record

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
