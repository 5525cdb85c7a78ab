"""A source around another one: forwards everything, so that a subclass changes only what it is for."""

from haptigraph.messages import Capture
from haptigraph.stages import Source

__all__ = ["SourceWrapper"]


class SourceWrapper(Source):
    """Forward to another source.

    Args:
        source: The wrapped source; closed together with this one.
    """

    def __init__(self, source: Source) -> None:
        self._source = source
        self.rate_hz, self.is_live, self.registration = source.rate_hz, source.is_live, source.registration
        self.notes, self.teleop, self.robot_setup = source.notes, source.teleop, source.robot_setup
        self.depth_camera = source.depth_camera

    def read(self, timeout_s: float) -> Capture | None:
        """Return the next capture of the wrapped source."""
        return self._source.read(timeout_s)

    def close(self) -> None:
        """Close the wrapped source."""
        self._source.close()
