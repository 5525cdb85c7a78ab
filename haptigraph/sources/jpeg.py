"""Pass images through JPEG before perception sees them, so that a recording is small and still exact."""

from msgspec.structs import replace

from haptigraph.messages import Capture
from haptigraph.recording.codec import decode, encode_jpeg
from haptigraph.stages import Source

__all__ = ["JpegSource"]


class JpegSource:
    """Wrap a source of raw images; images that come as bytes already pass as they are.

    Args:
        source: The source.
        quality: 1 to 100.
    """

    def __init__(self, source: Source, quality: int) -> None:
        self._source, self._quality = source, quality
        self.rate_hz, self.is_live, self.registration = source.rate_hz, source.is_live, source.registration
        self.teleop = getattr(source, "teleop", None)
        """Where a hand steers the source, if it can be steered."""
        self.notes = getattr(source, "notes", ())
        """What a camera says of itself."""

    def read(self, timeout_s: float) -> Capture | None:
        """Return the next capture, decoded from the bytes it carries."""
        capture = self._source.read(timeout_s)
        if capture is None or capture.image is None or capture.encoded is not None:
            return capture
        encoded = encode_jpeg(capture.image, self._quality)
        return replace(capture, image=decode(encoded), encoded=encoded)

    def close(self) -> None:
        """Close the source."""
        self._source.close()
