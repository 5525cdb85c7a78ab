"""Images of the simulated phantom, each with its ground truth."""

from haptigraph.errors import EndOfSource
from haptigraph.messages import Capture, HandState
from haptigraph.sim.oct.phantom import open_phantom
from haptigraph.sim.phantom import Moment
from haptigraph.sources.timing import moved_in_time
from haptigraph.stages import Source

__all__ = ["PhantomSource", "capture_of"]


def capture_of(moment: Moment, index: int, stamp_ns: int, hand: HandState | None = None) -> Capture:
    """Return a moment of the phantom as the capture of an image with a stamp."""
    start_ns = round(moment.time_s * 1e9)
    capture = Capture(
        index,
        start_ns,
        moment.image,
        truth=moment.truth,
        hand=hand,
        phase=moment.phase,
        robot=moment.robot,
        depth=moment.depth,
    )
    return moved_in_time(capture, stamp_ns - start_ns)


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
        self.registration, self.robot_setup = self._phantom.registration, self._phantom.robot_setup
        self.depth_camera = self._phantom.depth_camera

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
        return capture_of(moment, self._index, stamp_ns)

    def close(self) -> None:
        """Do nothing: the phantom holds no resources."""
