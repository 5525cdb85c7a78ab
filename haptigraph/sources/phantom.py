"""Images of the simulated phantom, each with its ground truth."""

from haptigraph.errors import EndOfSource
from haptigraph.messages import Capture
from haptigraph.sim.oct.phantom import open_phantom
from haptigraph.stages import Source

__all__ = ["PhantomSource"]


class PhantomSource(Source):
    """Play a scenario.

    Args:
        name: A scenario that ships with haptigraph, or the path of a .toml file.
        loop: Whether to restart the scenario when it ends.
        target_mm: Position of the target along the retina; None: the scenario's own.

    Raises:
        BadInput: If there is no such scenario.
    """

    is_live = False

    def __init__(self, name: str, *, loop: bool = False, target_mm: float | None = None) -> None:
        self._phantom = open_phantom(name, target_mm)
        self._loop = loop
        self._index = -1
        self.rate_hz = self._phantom.scenario.about.rate_hz
        self.registration = self._phantom.registration

    def read(self, timeout_s: float) -> Capture | None:
        """Return the next image."""
        moment = self._phantom.advance()
        if moment is None and self._loop:
            self._phantom.restart()
            moment = self._phantom.advance()
        if moment is None:
            raise EndOfSource
        self._index += 1
        stamp_ns = round(self._index * 1e9 / self.rate_hz)
        return Capture(self._index, stamp_ns, moment.image, truth=moment.truth, phase=moment.phase)

    def close(self) -> None:
        """Do nothing: the phantom holds no resources."""
