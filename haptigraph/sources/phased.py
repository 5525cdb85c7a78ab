"""Label every capture with the phase of the operation that a person or a script has set.

Phases are never inferred: a phase may silence an alarm, so somebody must have chosen it.
"""

from collections.abc import Sequence

from msgspec.structs import replace

from haptigraph.errors import BadInput, unknown_name
from haptigraph.messages import Capture
from haptigraph.sources.wrapper import SourceWrapper
from haptigraph.stages import Source

__all__ = ["PhasedSource", "phased"]


def phased(source: Source, phases: Sequence[str], first: str) -> Source:
    """Return a source that labels phases, if the procedure has any.

    Args:
        source: The source.
        phases: The procedure's phases, in order.
        first: The initial phase; empty: the first one.

    Raises:
        BadInput: If `first` is not one of the phases.
    """
    if first and first not in phases:
        raise BadInput(unknown_name("phase", first, phases or ["none, for this procedure"]), "trial.phase")
    return PhasedSource(source, phases, first) if phases else source


class PhasedSource(SourceWrapper):
    """Label captures with the phase set by a person, else by the source, else the initial one.

    Args:
        source: The source.
        phases: Names of the phases, in order.
        first: The initial phase; empty: the first one.
    """

    def __init__(self, source: Source, phases: Sequence[str], first: str = "") -> None:
        super().__init__(source)
        self.phases = tuple(phases)
        self.named = ""
        """The phase that a person set last, from any thread; empty: none yet."""
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
