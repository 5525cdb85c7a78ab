"""Every contract of the loop on one page. A stage is anything that fits its Protocol; none need import us.

The four stages in the middle (perceive, build scene, reason, render) are deterministic: no clock, no I/O,
no unseeded chance. What they remember, `reset` forgets. `assemble` chooses the classes.
"""

from typing import Protocol, runtime_checkable

from haptigraph.graph import SceneGraph
from haptigraph.messages import (
    Capabilities,
    Capture,
    Conclusion,
    Fault,
    HapticCommand,
    Observation,
    Step,
)

__all__ = ["Device", "Perceiver", "Reasoner", "Renderer", "SceneBuilder", "Sink", "Source"]


@runtime_checkable
class Source(Protocol):
    """Deliver images, oldest first."""

    rate_hz: float
    """Images per second, nominally."""
    is_live: bool
    """True if images come when they come (camera, steered robot); False if the run paces them (file)."""
    registration: str | None
    """TOML text of the registration that belongs to these images, where the source knows it."""

    def read(self, timeout_s: float) -> Capture | None:
        """Return the next capture, or None if none came in time.

        A live source stamps captures with the run's clock and returns only the newest; any other stamps
        them with its own time from 0.

        Raises:
            EndOfSource: After the last image.
            SourceLost: If a live source went away; reading again tries to get it back.
            BadInput: If an image cannot be decoded.
        """
        ...

    def close(self) -> None:
        """Release the hardware or file. May be called twice."""
        ...


@runtime_checkable
class Perceiver(Protocol):
    """Turn an image (px) into where things are (eye frame, mm)."""

    def __call__(self, capture: Capture) -> Observation:
        """Look at one image; `capture.image` is never None. What is not found is left out."""
        ...

    def reset(self) -> None:
        """Forget earlier images."""
        ...


@runtime_checkable
class SceneBuilder(Protocol):
    """Turn an observation into the relations that hold."""

    def __call__(self, observation: Observation) -> SceneGraph:
        """Build the graph of one image."""
        ...

    def reset(self) -> None:
        """Forget which relations held."""
        ...


@runtime_checkable
class Reasoner(Protocol):
    """Turn a scene graph into the surgical state."""

    def __call__(self, graph: SceneGraph) -> Conclusion:
        """Infer the state; every graph has one."""
        ...

    def reset(self) -> None:
        """Forget earlier graphs."""
        ...


@runtime_checkable
class Renderer(Protocol):
    """Turn a state into what the hand feels."""

    def __call__(self, conclusion: Conclusion) -> HapticCommand:
        """Choose the pattern and when it began."""
        ...

    def reset(self) -> None:
        """Forget what is playing."""
        ...


@runtime_checkable
class Device(Protocol):
    """Make one actuator vibrate. Called only by the guard."""

    capabilities: Capabilities
    """What it can do; known once it is open."""

    def set(self, amplitude: float, frequency_hz: float, stamp_ns: int) -> None:
        """Vibrate so from now on, until told otherwise or `capabilities.holds_ms` have passed; 0 is silence.

        The first call is silence, so that whatever a device did before is over.

        Args:
            amplitude: Strength in [0, 1].
            frequency_hz: Frequency, if the device can choose it.
            stamp_ns: The moment this is meant for.

        Raises:
            DeviceError: If the device does not obey.
        """
        ...

    def close(self) -> None:
        """Fall silent and release the device. May be called twice."""
        ...


@runtime_checkable
class Sink(Protocol):
    """Take every step away. Must not block in real time: what cannot be kept is dropped and counted."""

    dropped: int
    """Items lost so far."""

    def write(self, capture: Capture, step: Step) -> None:
        """Take one step and the capture it came from."""
        ...

    def take_faults(self) -> tuple[Fault, ...]:
        """Return what went wrong since last asked."""
        ...

    def close(self) -> None:
        """Finish writing. May be called twice."""
        ...
