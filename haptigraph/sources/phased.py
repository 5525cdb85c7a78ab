"""Say with every image in which phase of the operation it was taken, as a person or a script says it.

Nothing is inferred: a phase may silence an alarm, so somebody must have meant it.
"""

from collections.abc import Sequence

from msgspec.structs import replace

from haptigraph.errors import BadInput, unknown_name
from haptigraph.messages import Capture
from haptigraph.stages import Source

__all__ = ["PhasedSource", "phased"]


def phased(source: Source, phases: Sequence[str], first: str) -> Source:
    """Return a source that tells phases, if there are any; `first` is the one to begin in, if given.

    Raises:
        BadInput: If it is none of them.
    """
    if first and first not in phases:
        raise BadInput(unknown_name("phase", first, phases or ["none, for this procedure"]), "trial.phase")
    return PhasedSource(source, phases, first) if phases else source


class PhasedSource:
    """Wrap a source; where somebody names a phase that counts, else the source's own, else the first.

    Args:
        source: The source.
        phases: Names of the phases, in their order.
        first: The one to begin in; empty: the first of them.
    """

    def __init__(self, source: Source, phases: Sequence[str], first: str = "") -> None:
        self._source, self.phases = source, tuple(phases)
        self.named = ""
        """The phase that somebody named last, from any thread; empty: nobody has yet."""
        self.rate_hz, self.is_live, self.registration = source.rate_hz, source.is_live, source.registration
        self.teleop = getattr(source, "teleop", None)
        """Where a hand steers the source, if it can be steered."""
        self.notes = getattr(source, "notes", ())
        """What a camera says of itself."""
        self._first = first or self.phases[0]
        self._now, self._since_ns = "", 0

    def read(self, timeout_s: float) -> Capture | None:
        """Return the next capture, with its phase."""
        capture = self._source.read(timeout_s)
        if capture is None:
            return None
        phase = self.named or capture.phase or self._first
        if phase != self._now:
            self._now, self._since_ns = phase, capture.stamp_ns
        return replace(capture, phase=phase, phase_s=(capture.stamp_ns - self._since_ns) / 1e9)

    def close(self) -> None:
        """Close the source."""
        self._source.close()
