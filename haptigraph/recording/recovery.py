"""Rescue recordings: complete interrupted ones, and save what can be verified of damaged ones."""

import glob
import re
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

from mcap.records import Channel, Header, McapRecord, Message, Metadata, Schema, Statistics
from msgspec import Struct

from haptigraph.errors import BadInput
from haptigraph.recording.attachments import AttachedFile
from haptigraph.recording.codec import decode, decode_depth
from haptigraph.recording.compaction import LIBRARY, Progress, write_compacted
from haptigraph.recording.decoding import DEPTH, IMAGE, decode_message, is_complete
from haptigraph.recording.header import Losses, is_header, is_losses, losses_record, read_header, read_losses
from haptigraph.recording.journal import FileIdentity, is_being_written, is_whole, not_being_written
from haptigraph.recording.scan import Damage, Piece, open_regular, scan

__all__ = ["Recovery", "recover"]


class Recovery(Struct):
    """What a recovery found and did."""

    path: Path
    """The recording."""
    saved: Path | None = None
    """Where it is complete again; None: it was complete."""
    steps: int = 0
    """Complete steps in it."""
    damage: list[Damage] = []
    """What cannot be read; the last may be only torn."""
    missing: list[tuple[int, int]] = []
    """First and last number of steps that are missing, from 0."""
    lost_images: int = 0
    """Complete steps whose image is lost, because the video in the recording is."""
    lacked: bool = False
    """Whether the recording itself was recovered from a damaged one; it says what it lacks."""
    failure: str = ""
    """Why later steps were never recorded, although the run went on; empty: it is not known that any were."""
    is_verified: bool = True
    """False if messages have no checksum (formats 1 and 2), so that changed numbers were not noticed."""
    removed: list[Path] = []
    """Unfinished copies that an earlier, interrupted attempt left."""
    left: list[Path] = []
    """Files with the name of such a copy that were not removed."""

    @property
    def lost(self) -> list[Damage]:
        """Damage that is more than the torn end of an interrupted run."""
        return [damage for damage in self.damage if damage.kind in ("lost", "cut")]

    @property
    def is_lossless(self) -> bool:
        """Whether nothing but the torn end of an interrupted run is left out."""
        return not (self.lost or self.missing or self.lost_images or self.lacked)

    @property
    def left_out_bytes(self) -> int:
        """Bytes that cannot be read."""
        return sum(damage.end - damage.start for damage in self.damage if damage.kind != "summary")

    def losses(self) -> Losses:
        """Return what is missing, for the recovered recording."""
        places = (f"byte {damage.start}: {damage.problem}" for damage in self.lost)
        images = str(self.lost_images) if self.lost_images else ""
        return Losses(_missing_text(self.missing), "; ".join(places), images, self.failure)


class _Definitions(Struct):
    """What is needed to read messages, wherever it is in the file."""

    header: Metadata | None = None
    losses: list[Metadata] = []
    video: AttachedFile | None = None
    schemas: dict[int, Schema] = {}
    channels: dict[int, Channel] = {}
    total: int | None = None
    """Number of steps according to the file's summary."""

    def take_header(self, record: Metadata, path: Path) -> str:
        """Take a header; return what is wrong with it, if anything."""
        try:
            read_header(record, path)
        except BadInput as error:
            return error.problem
        self.header = record
        return ""

    def records(self) -> Iterator[McapRecord]:
        """Yield them in the order in which a recording begins."""
        if self.header is not None:
            yield self.header
        yield from self.losses
        yield from (self.video,) if self.video is not None else ()
        yield from self.schemas.values()
        yield from (channel for channel in self.channels.values() if channel.schema_id in self.schemas)


def recover(path: Path, progress: Progress | None = None) -> Recovery:
    """Verify a recording, and save it if it was interrupted or damaged.

    An interrupted recording is completed in place. What is left of a damaged one is saved beside it, in
    NAME.recovered.mcap, and the file itself is not touched.

    Raises:
        BadInput: If the file is not a recording, is still being written, or contains no complete step.
        OSError: If it cannot be written.
    """
    report = progress or (lambda what, done, total: None)
    open_regular(path).close()
    with not_being_written(path):
        identity = FileIdentity.of(path)
        definitions = _definitions(path)
        recovery = _check(path, definitions, report)
        lacks = recovery.missing or recovery.lost_images
        if recovery.damage or not is_whole(path) or (lacks and not recovery.lacked):
            target = path if recovery.is_lossless else path.with_suffix(f".recovered{path.suffix}")
            if target != path and target.exists():
                raise BadInput("exists already; recover never overwrites a file, so move it away", target)
            identity.check(path)
            write_compacted(target, _saved_records(path, definitions, recovery, identity))
            recovery.saved = target
        _remove_remnants(recovery)
        return recovery


def _missing_text(missing: list[tuple[int, int]]) -> str:
    """Return ranges of steps as text: "3, 9-12"."""
    return ", ".join(str(first) if first == last else f"{first}-{last}" for first, last in missing)


def _definitions(path: Path) -> _Definitions:
    """Read header, schemas, channels and totals, from the first copies that can be verified.

    Raises:
        BadInput: If there is no header, or only damaged ones.
    """
    found, problem = _Definitions(), "not a recording of haptigraph (its header is missing)"
    for piece in scan(path):
        for record in piece.records if isinstance(piece, Piece) else ():
            if isinstance(record, Schema):
                found.schemas.setdefault(record.id, record)
            elif isinstance(record, Channel):
                found.channels.setdefault(record.id, record)
            elif isinstance(record, Statistics):
                found.total = max(record.channel_message_counts.values(), default=0)  # /log may have more
            elif isinstance(record, AttachedFile):
                found.video = record
            elif isinstance(record, Metadata) and is_losses(record):
                found.losses += [] if record in found.losses else [record]
            elif isinstance(record, Metadata) and is_header(record) and found.header is None:
                problem = found.take_header(record, path) or problem
    if found.header is None:
        raise BadInput(problem, path)
    return found


def _check(path: Path, definitions: _Definitions, report: Progress) -> Recovery:
    """Read the whole file, and count what is complete and what is missing.

    Raises:
        BadInput: If there is no complete step.
    """
    before = [read_losses(record, path) for record in definitions.losses]
    recovery, found, size = Recovery(path), [-1], path.stat().st_size
    recovery.failure = next((each.failure for each in before if each.failure), "")
    recovery.lacked = any(each.damage or each.missing or each.images for each in before)
    for piece in scan(path):
        report("checking the recording", piece.end, size)
        if isinstance(piece, Damage):
            recovery.damage.append(piece)
        elif any(is_header(record) and record != definitions.header for record in piece.records):
            recovery.damage.append(Damage(piece.start, piece.end, "the header is damaged", "lost"))
        elif not piece.has_crc and any(isinstance(record, Message) for record in piece.records):
            recovery.is_verified = False
    for group, is_good in _groups(path, definitions, checks_images=not recovery.is_verified):
        if is_good and group[0].sequence > found[-1]:
            found.append(group[0].sequence)
            recovery.lost_images += definitions.video is None and _is_in_video(group, definitions, path)
    recovery.steps = len(found) - 1
    if not recovery.steps:
        where = "".join(f" (byte {damage.start}: {damage.problem})" for damage in recovery.damage[:1])
        raise BadInput(f"contains no complete step{where}, so there is nothing to recover", path)
    recovery.missing = [(before + 1, after - 1) for before, after in pairwise(found) if after > before + 1]
    if definitions.total is not None and found[-1] + 1 < definitions.total:
        recovery.missing.append((found[-1] + 1, definitions.total - 1))
    return recovery


def _groups(
    path: Path, definitions: _Definitions, *, checks_images: bool
) -> Iterator[tuple[list[Message], bool]]:
    """Yield the messages of each step, and whether it is complete and can be decoded."""
    group, is_cut = list[Message](), False
    for piece in scan(path):
        if isinstance(piece, Damage):
            is_cut = is_cut or piece.kind in ("lost", "cut")
            continue
        for record in piece.records:
            if not isinstance(record, Message):
                continue
            if group and record.sequence != group[0].sequence:
                yield group, _is_good(group, definitions, path, checks_images=checks_images, is_cut=is_cut)
                group, is_cut = [], False
            group.append(record)
    if group:
        yield group, _is_good(group, definitions, path, checks_images=checks_images, is_cut=is_cut)


def _is_good(
    group: list[Message], definitions: _Definitions, path: Path, *, checks_images: bool, is_cut: bool
) -> bool:
    """Return whether a step is complete; beside a loss, its last message, which runs write, must be there."""
    messages = {}
    for record in group:
        channel = definitions.channels.get(record.channel_id)
        if channel is None or channel.schema_id not in definitions.schemas:
            return False
        try:
            messages[channel.topic] = decode_message(channel.topic, record, path)
        except BadInput:
            return False
    for topic, decoded in ((IMAGE, decode), (DEPTH, decode_depth)):
        if checks_images and topic in messages:
            try:
                decoded(messages[topic].data)
            except ValueError:
                return False
    return is_complete(messages) and ("/timing" in messages or not is_cut)


def _is_in_video(group: list[Message], definitions: _Definitions, path: Path) -> bool:
    """Return whether the image of a complete step is in the recording's video."""
    topics = ((definitions.channels[record.channel_id].topic, record) for record in group)
    captures = (decode_message(topic, record, path) for topic, record in topics if topic == "/capture")
    return any(capture.video is not None for capture in captures)


def _saved_records(
    path: Path, definitions: _Definitions, recovery: Recovery, identity: FileIdentity
) -> Iterator[McapRecord]:
    """Yield the records of the recovered recording."""
    yield from definitions.records()
    if not recovery.is_lossless:
        yield losses_record(recovery.losses())
    last = -1
    for group, is_good in _groups(path, definitions, checks_images=not recovery.is_verified):
        if is_good and group[0].sequence > last:
            yield from group
            last = group[0].sequence
    identity.check(path)


def _remove_remnants(recovery: Recovery) -> None:
    """Remove unfinished copies that a killed compaction left, unless the recording itself lacks something."""
    path = recovery.path
    for copy in sorted(path.parent.glob(f"{glob.escape(path.name)}.part*")):
        if not re.fullmatch(r"\.part\d*", copy.name.removeprefix(path.name)):
            continue
        if recovery.is_lossless and _is_unfinished_copy(copy):
            copy.unlink()
            recovery.removed.append(copy)
        else:
            recovery.left.append(copy)


def _is_unfinished_copy(path: Path) -> bool:
    """Return whether a file was begun by `compaction`, and nobody is writing it."""
    try:
        with open_regular(path) as file:
            is_empty = not file.read(1)
        if is_being_written(path):
            return False
        first = None if is_empty else next(iter(scan(path)), None)
    except (BadInput, OSError):
        return False
    header = first.records[0] if isinstance(first, Piece) and first.records else None
    return is_empty or (isinstance(header, Header) and header.library == LIBRARY)
