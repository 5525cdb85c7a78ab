"""Write runs to MCAP so that a killed process loses nothing, and compact them at the end.

A run is written as a journal: each step is a chunk with its CRC, written at once and not compressed. Before
the steps, it contains the video that the images come from, if any. On a clean close the file is rewritten
with zstd chunks and an index. `sinks.recorder` runs this in its own thread.
"""

import mimetypes
import os
import zlib
from collections import Counter, deque
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

import msgspec
import numpy as np
from mcap.data_stream import RecordBuilder
from mcap.records import Channel, Chunk, DataEnd, Footer, Header, McapRecord, Message, Schema, Statistics
from msgspec.structs import replace

from haptigraph.errors import BadInput
from haptigraph.messages import Capture, Step
from haptigraph.projection import ImageGeometry
from haptigraph.recording.attachments import CRC_BYTES, AttachedFile, write_attachment
from haptigraph.recording.compaction import Progress, compact
from haptigraph.recording.entries import entries
from haptigraph.recording.foxglove import encode_message
from haptigraph.recording.header import failure_losses, header_record, losses_record
from haptigraph.recording.journal import FileChanged, FileIdentity, Journal
from haptigraph.recording.scan import MAGIC, open_regular
from haptigraph.recording.schema import TOPICS, RunInfo, VideoImage, mcap_schema
from haptigraph.recording.stored_video import (
    StoredVideo,
    crc_of_pixels,
    decoder_name,
    is_smaller_than_images,
    png_bytes,
)

__all__ = ["Progress", "RunWriter"]

NEW_FILE = os.O_WRONLY | os.O_CREAT | os.O_EXCL | getattr(os, "O_BINARY", 0)
CHANNELS = {topic.name: number for number, topic in enumerate(TOPICS, 1)}
"""Numbers of the topics' channels and schemas."""


class RunWriter:
    """Append steps to a new recording.

    Args:
        path: The MCAP file; it must not exist.
        info: The header.
        image: Transformation between images and eye frame, for the annotations.
        measures: Names of the measures in the graphs.
        video: The video whose images will be written, unchanged and with their numbers in it; it is then
            stored instead of them. None: each image is stored.

    Raises:
        BadInput: If the file exists, has another suffix than .mcap, or cannot be created.
    """

    def __init__(
        self,
        path: str | Path,
        info: RunInfo,
        image: ImageGeometry,
        measures: tuple[str, ...],
        video: Path | None = None,
    ) -> None:
        self.path = Path(path)
        if self.path.suffix.lower() != ".mcap":
            raise BadInput("a recording is MCAP; its name ends in .mcap", path)
        self._info, self._image = replace(info, decoder=decoder_name()) if video else info, image
        self._video: StoredVideo | None = None
        self._video_bytes = self._images_bytes = 0
        self._problems = list[str]()
        try:
            self._file = Journal(os.open(self.path, NEW_FILE, 0o644), self.path)
        except FileExistsError:
            raise BadInput("exists already; a recording never overwrites a file", path) from None
        except FileNotFoundError:
            raise BadInput(
                f"cannot be written: there is no folder {self.path.parent}; create it first", path
            ) from None
        except OSError as error:
            raise BadInput(f"cannot be written ({error.strerror})", path) from None
        self.is_complete = False
        """Whether the file contains the complete run, compacted or not."""
        self.steps = 0
        """Number of steps written."""
        self._messages: Counter[int] = Counter()
        self._first_ns = self._last_ns = 0
        self._ends = deque[int](maxlen=2)
        """Where the last steps end in the file."""
        self._crc = 0
        try:
            self._begin(measures)
            if video is not None:
                self._store(video)
        except BaseException as error:
            self.discard()
            if isinstance(error, OSError):
                raise BadInput(f"cannot be written ({error.strerror})", path) from None
            raise

    def write(self, capture: Capture, step: Step, *, dropped: bool = False) -> None:
        """Append one step.

        Args:
            capture: The capture of the step.
            step: The step.
            dropped: True if there was an image that is not recorded.

        Raises:
            FileChanged: If somebody else deleted, replaced or changed the file.
            OSError: If it cannot be written.
        """
        utc_offset_ns = self._info.utc_offset_ns
        utc_ns = step.stamp_ns + utc_offset_ns
        kept = entries(
            capture,
            step,
            image=self._image,
            utc_offset_ns=utc_offset_ns,
            dropped=dropped,
            video=self._in_video(capture),
        )
        messages = [
            Message(CHANNELS[topic], utc_ns, encode_message(message), utc_ns, self.steps)
            for topic, message in kept
        ]
        self._append(_chunk(messages, utc_ns))
        self._messages.update(message.channel_id for message in messages)
        self._first_ns = min(self._first_ns, utc_ns) if self.steps else utc_ns
        self._last_ns = max(self._last_ns, utc_ns)
        self.steps += 1
        self._ends.append(self._file.tell())

    def take_problems(self) -> tuple[str, ...]:
        """Return why images are not stored as their video, since the last call, a sentence each."""
        problems, self._problems = tuple(self._problems), []
        return problems

    def close(self, progress: Progress | None = None) -> None:
        """Finish and compact the file, or remove it if it has no steps. May be called twice.

        Raises:
            BadInput: If the file is damaged.
            FileChanged: If somebody else deleted, replaced or changed it.
            OSError: If it cannot be written.
        """
        if self._file.closed:
            return
        if not self.steps:
            self.discard()
            return
        self._close_video()
        self._finish()
        identity = self._file.check()
        self._file.close()
        self.is_complete = True
        try:
            compact(self.path, progress, identity, unpacks_video=self._are_images_smaller())
        except (BadInput, FileChanged):
            self.is_complete = False
            raise

    def abandon(self, reason: str = "") -> None:
        """Close the file as it is, for instance after a disk error; `recover` can repair it.

        Args:
            reason: Why later steps are lost; on a full disk it takes the place of the last step.
        """
        self._close_video()
        for steps in (self.steps, self.steps - 1) if reason else ():
            if steps > 0 and self._wrote_failure(reason, steps):
                break
        with suppress(OSError):  # the caller has reported the error
            self._file.close()

    def discard(self) -> None:
        """Close and remove the file of a run that never began; do nothing once it is closed."""
        if self._file.closed:
            return
        is_ours = self._file.is_at_its_path()
        self.abandon()
        if is_ours:
            self.path.unlink(missing_ok=True)

    def _wrote_failure(self, reason: str, steps: int) -> bool:
        """Write behind the last steps that the later ones are lost; return False if that is impossible."""
        try:
            self._file.rewind(self._ends[steps - self.steps - 1])
            self._file.write(_encoded(losses_record(failure_losses(reason, steps))))
        except (FileChanged, OSError, ValueError):  # the latter of a closed file
            return False
        return True

    def _begin(self, measures: tuple[str, ...]) -> None:
        """Write header, schemas and channels, each twice: without them the rest cannot be read."""
        definitions = list[McapRecord]()
        for topic in TOPICS:
            number, schema = CHANNELS[topic.name], msgspec.json.encode(mcap_schema(topic, measures))
            definitions.append(Schema(number, schema, "jsonschema", topic.schema))
            definitions.append(Channel(number, topic.name, "json", {}, number))
        start = _encoded(Header("", f"haptigraph {self._info.version}"))
        self._append(MAGIC + start + 2 * (_encoded(header_record(self._info)) + _chunk(definitions)))

    def _store(self, video: Path) -> None:
        """Write the video, unless that takes more space than its images; if it fails, leave nothing of it."""
        at, crc = self._file.tell(), self._crc
        try:
            if not is_smaller_than_images(video):
                return
            with open_regular(video) as source:
                found, identity = os.fstat(source.fileno()), FileIdentity.of(source.fileno())
                kind = mimetypes.guess_type(video.name)[0] or "application/octet-stream"
                times = int(found.st_mtime_ns), self._info.utc_offset_ns
                file = AttachedFile(video, 0, identity.size, video.name, kind, *times)
                write_attachment(file, source, self._append)
                identity.check(video)
        except (BadInput, FileChanged, OSError) as error:
            self._file.rewind(at)
            self._crc = crc
            reason = error.strerror if isinstance(error, OSError) else getattr(error, "problem", str(error))
            self._problems.append(f"{video} is not stored in the recording, but each image as PNG: {reason}")
            return
        self._video_bytes = identity.size
        start = self._file.tell() - identity.size - CRC_BYTES
        self._video = StoredVideo(file.at(self.path, start))

    def _in_video(self, capture: Capture) -> VideoImage | None:
        """Return which image of the stored video a capture has, if decoding that gives the same pixels."""
        if self._video is None or capture.image is None:
            return None
        crc32 = crc_of_pixels(capture.image)
        try:
            image, _ = self._video.image(capture.index, crc32)
            if np.array_equal(image, capture.image):
                self._images_bytes += png_bytes(*image.shape)
                return VideoImage(capture.index, crc32)
            reason = "has other pixels"
        except ValueError:
            reason = "cannot be decoded"
        name = self._video.file.name
        self._close_video()
        self._problems.append(
            f"image {capture.index} of {name}, as stored in the recording, {reason}; from here on, "
            "each image is stored as PNG"
        )
        return None

    def _are_images_smaller(self) -> bool:
        """Return whether the images used would take much less space as PNG than the whole video."""
        return 2 * self._images_bytes < self._video_bytes

    def _close_video(self) -> None:
        if self._video is not None:
            self._video.close()
            self._video = None

    def _finish(self) -> None:
        """Write the records at the end: the checksum of all data, and how many messages there are."""
        end = _encoded(DataEnd(self._crc))
        summary_start = self._file.tell() + len(end)
        summary = _encoded(
            Statistics(
                attachment_count=int(self._video_bytes > 0),
                channel_count=len(TOPICS),
                channel_message_counts=dict(self._messages),
                chunk_count=self.steps + 2,
                message_count=self._messages.total(),
                message_end_time=self._last_ns,
                message_start_time=self._first_ns,
                metadata_count=2,
                schema_count=len(TOPICS),
            )
        )
        footer = _encoded(Footer(summary_start, 0, 0))[:-4]
        crc = zlib.crc32(summary + footer)
        self._file.write(end + summary + footer + crc.to_bytes(4, "little") + MAGIC)

    def _append(self, data: bytes) -> None:
        self._file.write(data)
        self._crc = zlib.crc32(data, self._crc)


def _chunk(records: Sequence[McapRecord], utc_ns: int = 0) -> bytes:
    """Return a chunk with its CRC; `utc_ns` is the time of all its messages."""
    data = b"".join(map(_encoded, records))
    return _encoded(Chunk("", data, utc_ns, utc_ns, zlib.crc32(data), len(data)))


def _encoded(record: McapRecord) -> bytes:
    builder = RecordBuilder()
    record.write(builder)
    data: bytes = builder.end()  # type: ignore[no-untyped-call]
    return data
