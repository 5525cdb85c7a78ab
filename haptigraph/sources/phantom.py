"""Images of the simulated phantom, with the truth beside each."""

from haptigraph.errors import EndOfSource
from haptigraph.messages import Capture
from haptigraph.sim.oct.phantom import open_phantom

__all__ = ["PhantomSource"]


class PhantomSource:
    """Play a scenario.

    Args:
        name: Of a scenario that ships with haptigraph, or the path of a .toml file.
        loop: Whether to start again when it is over.
        target_mm: Where the target lies along the retina; None: as the scenario says.

    Raises:
        BadInput: If there is no such scenario.
    """

    is_live = False

    def __init__(self, name: str, *, loop: bool = False, target_mm: float | None = None) -> None:
        self._phantom = open_phantom(name, target_mm)
        self._loop = loop
        self._index = -1
        self.rate_hz = self._phantom.scenario.about.rate_hz
        self.registration: str | None = self._phantom.registration

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
        """Do nothing: nothing stays open."""
