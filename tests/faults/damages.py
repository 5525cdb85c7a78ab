"""Damage recordings, and compare what is left of them."""

import re
from itertools import islice
from pathlib import Path

import cv2
import msgspec
import pytest
from msgspec.structs import replace

from haptigraph.recording import compaction
from haptigraph.recording.codec import encode_jpeg
from haptigraph.recording.reader import RunReader
from haptigraph.recording.scan import MAGIC
from haptigraph.recording.writer import RunWriter
from haptigraph.registration.loading import parse_registration

STEPS = 37


def content(path):
    """Return the header and, by number, everything else that a recording says."""
    reader = RunReader(path)
    steps = {}
    for (place, _), (capture, step) in zip(reader.places(), reader.records(), strict=True):
        steps[place.sequence] = msgspec.json.encode((replace(capture, image=capture.image.tobytes()), step))
    return reader.info, steps


def make_files(recording: Path, folder: Path) -> None:
    """Write the first steps of a recording with small images: journal.mcap, not finished, and whole.mcap."""
    source = RunReader(recording)
    geometry = parse_registration(source.info.registration, "x").image
    config = re.sub(r'"path":"[^"]*"', '"path":""', source.info.config)
    info = replace(source.info, started_utc="2026-01-01T00:00:00+00:00", utc_offset_ns=10**18, config=config)
    writer = RunWriter(folder / "whole.mcap", info, geometry, ("theta_deg",))
    for capture, step in islice(source.records(), STEPS):
        step = replace(step, timing=replace(step.timing, stage_ns={}))  # each run damages the same bytes
        image = cv2.resize(capture.image, (48, 32))
        writer.write(replace(capture, image=image, encoded=encode_jpeg(image, 90)), step)
    (folder / "journal.mcap").write_bytes((folder / "whole.mcap").read_bytes())
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(compaction, "CHUNK_BYTES", 20_000)
        writer.close()


def flip(data, rng):
    data[rng.randrange(len(data))] ^= 1 << rng.randrange(8)


def cut_out(data, rng):
    start = rng.randrange(len(data))
    del data[start : start + rng.randint(1, 3000)]


def insert(data, rng):
    start = rng.randrange(len(data))
    data[start:start] = rng.choice((rng.randbytes, bytes))(rng.randint(1, 3000))


def repeat(data, rng):
    start = rng.randrange(len(data))
    data[start:start] = data[start : start + rng.randint(1, 20_000)]


def overwrite(data, rng):
    start = rng.randrange(len(data))
    part = data[start : start + rng.randint(1, 3000)]
    data[start : start + len(part)] = rng.choice((rng.randbytes, bytes))(len(part))


def change_length(data, rng):
    """Flip a bit in the length of a record, found by its type and the upper bytes of its length."""
    starts = [at for at in range(8, len(data) - 9) if data[at] == 6 and not any(data[at + 5 : at + 9])]
    data[rng.choice(starts) + 1 + rng.randrange(8)] ^= 1 << rng.randrange(8)


def truncate(data, rng):
    del data[rng.randrange(len(MAGIC), len(data)) :]


DAMAGES = (flip, flip, cut_out, insert, repeat, overwrite, change_length, truncate)
GENERAL_DAMAGES = (flip, cut_out, insert, repeat, overwrite)
"""Of any file that is not empty."""
