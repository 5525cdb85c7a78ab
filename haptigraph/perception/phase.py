"""The phase of the operation as an entity of the scene, besides what a perceiver finds in the image."""

from collections.abc import Sequence

from msgspec.structs import replace

from haptigraph.geometry import Phase
from haptigraph.messages import Capture, Observation
from haptigraph.stages import Perceiver

__all__ = ["PhasedPerceiver"]


class PhasedPerceiver:
    """Add the phase that a capture names to what a perceiver finds.

    Args:
        perceiver: Processes the image.
        phases: Those of the procedure; others are left out.
    """

    def __init__(self, perceiver: Perceiver, phases: Sequence[str]) -> None:
        self._perceiver, self._phases = perceiver, frozenset(phases)

    def __call__(self, capture: Capture) -> Observation:
        """Observe one image."""
        observation = self._perceiver(capture)
        if capture.phase not in self._phases:
            return observation
        return replace(observation, found={**observation.found, capture.phase: Phase(capture.phase_s)})

    def reset(self) -> None:
        """Forget earlier images."""
        self._perceiver.reset()
