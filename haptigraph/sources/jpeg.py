"""Pass images through JPEG before perception processes them: recordings stay small and replay exactly."""

from msgspec.structs import replace

from haptigraph.messages import Capture
from haptigraph.recording.codec import decode, encode_jpeg
from haptigraph.sources.wrapper import SourceWrapper
from haptigraph.stages import Source

__all__ = ["JpegSource"]


class JpegSource(SourceWrapper):
    """Compress raw images; images that already come as JPEG or PNG bytes stay as they are.

    Args:
        source: The source.
        quality: 1 to 100.
    """

    def __init__(self, source: Source, quality: int) -> None:
        super().__init__(source)
        self._quality = quality

    def read(self, timeout_s: float) -> Capture | None:
        """Return the next capture, decoded from the bytes it carries."""
        capture = self._source.read(timeout_s)
        if capture is None or capture.image is None or capture.encoded is not None:
            return capture
        encoded = encode_jpeg(capture.image, self._quality)
        return replace(capture, image=decode(encoded), encoded=encoded)
