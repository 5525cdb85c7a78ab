"""Export a recorded run as XDF, the file format of LabRecorder, with the streams of the LSL bridge.

https://github.com/sccn/xdf/wiki/Specifications: "XDF:", then chunks of length, tag and content,
little-endian.
"""

import struct
import uuid
from collections.abc import Iterable, Sequence
from datetime import datetime
from io import BytesIO
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

from haptigraph.analysis.exporting.lsl_streams import IRREGULAR_RATE_HZ, LslSamples, LslStream, lsl_streams
from haptigraph.analysis.exporting.writing import write_new
from haptigraph.assemble import parse_procedure
from haptigraph.recording.reader import RunReader
from haptigraph.recording.writer import Progress

__all__ = ["XdfFile", "run_xdf"]

FILE_HEADER, STREAM_HEADER, SAMPLES, CLOCK_OFFSET, BOUNDARY, STREAM_FOOTER = range(1, 7)
BOUNDARY_ID = uuid.UUID("43a546dc-cbf5-410f-b30e-d5467383cbe4").bytes
"""Where a reader of a damaged file may go on, by the specification."""


class XdfFile:
    """Collect streams and write them as one file.

    Args:
        started_utc: When the streams began, ISO 8601.
        started_s: The same, on the clock of the stamps.
    """

    def __init__(self, started_utc: str, started_s: float) -> None:
        self._started_s = started_s
        self._data = BytesIO()
        self._data.write(b"XDF:")
        self._chunk(FILE_HEADER, _xml({"version": "1.0", "datetime": started_utc}))
        self._samples: list[list[bytes]] = []
        self._stamps_s: list[list[float]] = []

    def add_stream(self, stream: LslStream) -> int:
        """Add a stream, and return its number."""
        self._samples.append([])
        self._stamps_s.append([])
        number = len(self._samples)
        kind = stream.type
        channels = [
            {"label": label, "unit": unit, "type": kind}
            for label, unit in zip(stream.channels, stream.units, strict=True)
        ]
        info = {
            "name": stream.name,
            "type": kind,
            "channel_count": str(len(stream.channels)),
            "nominal_srate": f"{IRREGULAR_RATE_HZ:g}",
            "channel_format": "string" if stream.is_text else "double64",
            "source_id": stream.name,
            "version": "1.1",
            "created_at": repr(self._started_s),
            "desc": {**stream.description, "channels": {"channel": channels}},
        }
        self._chunk(STREAM_HEADER, _xml(info), number)
        return number

    def add_sample(self, number: int, values: Sequence[str] | Sequence[float], stamp_s: float) -> None:
        """Add a sample to a stream; all streams are stamped on one clock [s]."""
        encoded = b"".join(
            _text(each) if isinstance(each, str) else struct.pack("<d", each) for each in values
        )
        self._samples[number - 1].append(struct.pack("<Bd", 8, stamp_s) + encoded)
        self._stamps_s[number - 1].append(stamp_s)

    def content(self) -> bytes:
        """Return the whole file; nothing can be added afterwards."""
        for number, samples in enumerate(self._samples, 1):
            self._chunk(SAMPLES, _length(len(samples)) + b"".join(samples), number)
        self._chunk(BOUNDARY, BOUNDARY_ID)
        for number, stamps_s in enumerate(self._stamps_s, 1):
            # LabRecorder measures how far a stream's clock is from its own; here it is the same clock.
            ends_s = (stamps_s[0], stamps_s[-1]) if stamps_s else ()
            for end_s in ends_s:
                self._chunk(CLOCK_OFFSET, struct.pack("<dd", end_s, 0.0), number)
            footer: dict[str, Any] = {"sample_count": str(len(stamps_s))}
            if ends_s:
                offsets = [{"time": repr(end_s), "value": "0"} for end_s in ends_s]
                footer = {
                    "first_timestamp": repr(ends_s[0]),
                    "last_timestamp": repr(ends_s[1]),
                    **footer,
                    "clock_offsets": {"offset": offsets},
                }
            self._chunk(STREAM_FOOTER, _xml(footer), number)
        return self._data.getvalue()

    def _chunk(self, tag: int, content: bytes, stream: int | None = None) -> None:
        number = b"" if stream is None else struct.pack("<I", stream)
        body = struct.pack("<H", tag) + number + content
        self._data.write(_length(len(body)) + body)


def run_xdf(path: str | Path, output: str | Path, progress: Progress | None = None) -> dict[str, int]:
    """Write one recorded run as XDF, and return the number of samples by stream.

    Stamps are those of the recording, on the run's clock [s].

    Args:
        path: The recording.
        output: The file to write.
        progress: Called with the number of steps written.

    Raises:
        BadInput: If the recording cannot be read, or the file exists or cannot be written.
    """
    reader = RunReader(path)
    measures = parse_procedure(reader.info.procedure, f"procedure in {path}").schema.measure_names
    started_utc = reader.info.started_utc
    started_s = datetime.fromisoformat(started_utc).timestamp() - reader.info.utc_offset_ns / 1e9
    file, samples = XdfFile(started_utc, started_s), LslSamples(measures)
    streams = lsl_streams(reader.info, measures)
    numbers = {key: file.add_stream(stream) for key, stream in streams.items()}
    counts = dict.fromkeys((stream.name for stream in streams.values()), 0)
    for written, (_, step) in enumerate(reader.places(), 1):
        for sample in samples.of_step(step):
            file.add_sample(numbers[sample.stream], sample.values, sample.stamp_ns / 1e9)
            counts[streams[sample.stream].name] += 1
        if progress is not None:
            progress("writing", written, 0)
    write_new(output, file.content())
    return counts


def _length(count: int) -> bytes:
    """Encode a length as XDF does: the number of its bytes, then the bytes."""
    return struct.pack("<BB", 1, count) if count < 256 else struct.pack("<BI", 4, count)


def _text(text: str) -> bytes:
    data = text.encode()
    return _length(len(data)) + data


def _xml(info: dict[str, Any]) -> bytes:
    root = ElementTree.Element("info")
    _append(root, info)
    return b'<?xml version="1.0"?>' + ElementTree.tostring(root)


def _append(parent: ElementTree.Element, values: dict[str, Any]) -> None:
    """Append elements: text, nested values, or a list of nested values with one tag."""
    for tag, value in values.items():
        entries: Iterable[Any] = value if isinstance(value, list) else [value]
        for each in entries:
            element = ElementTree.SubElement(parent, tag)
            if isinstance(each, dict):
                _append(element, each)
            else:
                element.text = each
