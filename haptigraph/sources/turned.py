"""Turn every image of another source: by steps of 90 degrees, and left to right."""

from pathlib import Path

from msgspec.structs import replace

from haptigraph.config import SourceConfig
from haptigraph.errors import BadInput
from haptigraph.imaging import Turn
from haptigraph.messages import Capture
from haptigraph.registration.loading import parse_registration
from haptigraph.sources.wrapper import SourceWrapper
from haptigraph.stages import Source

__all__ = ["TurnedSource", "turn_of", "turned"]


class TurnedSource(SourceWrapper):
    """Turn every image of a source.

    Args:
        source: The source.
        turn: How.
    """

    def __init__(self, source: Source, turn: Turn) -> None:
        super().__init__(source)
        self._turn = turn
        self.depth_camera = None

    def read(self, timeout_s: float) -> Capture | None:
        """Return the next capture, turned."""
        capture = self._source.read(timeout_s)
        if capture is None or capture.image is None:
            return capture
        return replace(capture, image=self._turn(capture.image), encoded=None, depth=None)


def turned(source: Source, kind: str, settings: SourceConfig) -> Source:
    """Turn the images of a source as configured.

    Args:
        source: The source; closed if it cannot be turned.
        kind: Its kind.
        settings: Say how.

    Raises:
        BadInput: If it states where the anatomy is, or delivers B-scans.
    """
    problem = ""
    if kind == "oct":
        problem = "B-scans are not turned, because their axial and lateral scale differ"
    elif source.registration is not None:
        problem = f"{settings.uri} brings its own registration, for the images as they are"
    if problem:
        source.close()
        raise BadInput(f"{settings.turn} are for cameras, videos and images; {problem}")
    return TurnedSource(source, settings.turn)


def turn_of(source: Source, settings: SourceConfig) -> Turn:
    """Return how the images of a source are turned; those of a recording are as perception saw them."""
    if Path(settings.uri).suffix.lower() != ".mcap" or source.registration is None:
        return settings.turn
    return parse_registration(source.registration, f"registration of {settings.uri}").turn
