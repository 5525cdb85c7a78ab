"""Encode pictures as an MP4 that browsers play, with PyAV; it gets its name once it is complete."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from fractions import Fraction
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from haptigraph.errors import BadInput, MissingExtra

if TYPE_CHECKING:
    import av
    from av.video.stream import VideoStream

__all__ = ["CODECS", "Encoding", "VideoFile", "new_video"]

CODECS = {"libx264": "H.264", "libopenh264": "H.264", "libvpx-vp9": "VP9"}
"""Encoders, the best first: every browser plays H.264; VP9 in MP4 not all."""
PER_S = 1000
"""Ticks of the time base: a picture is shown at its own time, to the millisecond."""
OPTIONS = {
    "libx264": {"crf": "20", "preset": "superfast"},
    "libvpx-vp9": {"crf": "30", "b:v": "0", "cpu-used": "8"},
}


class Encoding(NamedTuple):
    """How pictures are encoded."""

    codecs: Mapping[str, str]
    """What each encoder, the best first, encodes."""
    options: Mapping[str, dict[str, str]] = OPTIONS
    """By encoder."""
    pixels: str = "yuv420p"
    per_s: int = PER_S
    """Ticks of the time base."""


class VideoFile:
    """An open video; created by `new_video`.

    Args:
        container: The file.
        stream: Its only stream.
        codec: What it is encoded as.
        per_s: Ticks of the time base.
    """

    def __init__(
        self, container: "av.container.OutputContainer", stream: "VideoStream", codec: str, per_s: int
    ) -> None:
        self._container, self._stream, self.codec, self._per_s = container, stream, codec, per_s
        self._last = -1
        self.size_bytes = 0
        """Of the pictures encoded so far."""

    def add(self, picture: NDArray[np.uint8], time_s: float) -> None:
        """Append a picture, (height, width, 3) RGB, that is shown from a time on."""
        import av  # noqa: PLC0415 - optional

        frame = av.VideoFrame.from_ndarray(np.ascontiguousarray(picture), "rgb24")
        self._last = frame.pts = max(round(time_s * self._per_s), self._last + 1)
        frame.time_base = Fraction(1, self._per_s)
        packets = self._stream.encode(frame)
        self.size_bytes += sum(packet.size for packet in packets)
        self._container.mux(packets)


@contextmanager
def new_video(
    path: Path, width_px: int, height_px: int, rate_hz: float, encoding: Encoding | None = None
) -> Iterator[VideoFile]:
    """Create a video, which gets its name if the context ends without an error.

    Args:
        path: The MP4 file; it must not exist.
        width_px: Of every picture; even, unless the encoding stores every pixel's colour.
        height_px: Of every picture, as the width.
        rate_hz: Usual number of pictures in a second.
        encoding: How pictures are encoded; None: as browsers play them.

    Raises:
        BadInput: If it cannot be written, or PyAV has no encoder for it.
        MissingExtra: If PyAV is not installed.
    """
    try:
        import av  # noqa: PLC0415 - optional
    except ModuleNotFoundError:
        raise MissingExtra("a video", "video") from None
    codecs, options, pixels, per_s = encoding or Encoding(CODECS)
    encoder = next((name for name in codecs if name in av.codecs_available), None)
    if encoder is None:
        raise BadInput(f"cannot be encoded: this PyAV has none of {', '.join(codecs)}", path)
    part = path.with_name(f".{path.stem}.part.mp4")
    try:
        with av.open(str(part), "w", format="mp4", options={"movflags": "+faststart"}) as container:
            rate = Fraction(rate_hz).limit_denominator(PER_S)
            stream: Any = container.add_stream(
                encoder, rate, options.get(encoder)
            )  # which it is, types cannot tell
            stream.width, stream.height, stream.pix_fmt = width_px, height_px, pixels
            stream.codec_context.time_base = Fraction(1, per_s)
            yield VideoFile(container, stream, codecs[encoder], per_s)
            container.mux(stream.encode(None))
        part.replace(path)
    except OSError as error:
        raise BadInput(f"cannot be written ({error.strerror or error})", path) from None
    finally:
        part.unlink(missing_ok=True)
