"""The phase of the operation as a thing in the scene, beside what a perceiver finds.

Turns the phase a capture names into an entity. Sees nothing and infers nothing.
"""

from collections.abc import Sequence

from msgspec.structs import replace

from haptigraph.geometry import Phase
from haptigraph.messages import Capture, Observation
from haptigraph.stages import Perceiver

__all__ = ["PhasedPerceiver"]


class PhasedPerceiver:
    """Add the phase to what a perceiver finds.

    Args:
        perceiver: Looks at the image.
        phases: Those that the procedure knows; others are left out.
    """

    def __init__(self, perceiver: Perceiver, phases: Sequence[str]) -> None:
        self._perceiver, self._phases = perceiver, frozenset(phases)

    def __call__(self, capture: Capture) -> Observation:
        """Appearance at one image."""
        observation = self._perceiver(capture)
        if capture.phase not in self._phases:
            return observation
        return replace(observation, found={**observation.found, capture.phase: Phase(capture.phase_s)})

    def reset(self) -> None:
        """Forget earlier images."""
        self._perceiver.reset()
