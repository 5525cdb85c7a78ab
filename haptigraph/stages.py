"""Every contract of the loop, one Protocol a stage.

The four stages in the middle (perceive, build scene, reason, render) are deterministic: no clock, no I/O, no
unseeded randomness; `reset` clears their state. `assemble` chooses the classes and checks that a source and a
perceiver of your own have every member named here.
"""

from typing import Any, Protocol, runtime_checkable

from haptigraph.errors import BadInput
from haptigraph.graph import SceneGraph
from haptigraph.messages import (
    Capabilities,
    Capture,
    Conclusion,
    Fault,
    ForceSample,
    HapticCommand,
    ImageKind,
    Observation,
    RobotSample,
    Step,
)
from haptigraph.projection import DepthCamera

__all__ = [
    "Device",
    "ForceReadings",
    "Perceiver",
    "PerceiverClass",
    "Reasoner",
    "Renderer",
    "RobotReadings",
    "SceneBuilder",
    "Sink",
    "Source",
    "check_members",
]


@runtime_checkable
class Source(Protocol):
    """Deliver images, oldest first.

    A class that inherits from `Source` gets the defaults below; any other class must define every member.
    """

    rate_hz: float
    """Nominal images per second."""
    is_live: bool
    """True if the source sets the pace (camera, steered robot); False if the run does (file)."""
    registration: str | None = None
    """TOML text of the registration that belongs to these images, where the source knows it."""
    notes: tuple[str, ...] = ()
    """What the user should know before the run, a sentence each."""
    teleop: Any = None
    """The `haptigraph.teleop.teleop.Teleop` that steers the simulated robot; None if there is none."""

    robot_setup: str | None = None
    """TOML text of robot.toml, where the source delivers robot samples; None: it has none."""
    depth_camera: DepthCamera | None = None
    """The camera that measures the depths in its captures; None: there are none."""

    def read(self, timeout_s: float) -> Capture | None:
        """Return the next capture, or None if none arrived in time.

        A live source stamps captures with the run's clock and returns only the newest; any other source
        stamps them with its own time from 0.

        Raises:
            EndOfSource: After the last image.
            SourceLost: If a live source has disconnected; reading again tries to reconnect.
            BadInput: If an image cannot be decoded.
        """
        ...

    def close(self) -> None:
        """Release the hardware or file. May be called twice."""
        ...


@runtime_checkable
class Perceiver(Protocol):
    """Turn an image (px) into the positions of entities (eye frame, mm)."""

    def __call__(self, capture: Capture) -> Observation:
        """Process one image; `capture.image` is never None. What is not found is left out."""
        ...

    def reset(self) -> None:
        """Forget earlier images."""
        ...


@runtime_checkable
class PerceiverClass(Protocol):
    """What `assemble.PERCEIVERS` lists: a class of perceivers, with what it says of all of them."""

    entities: frozenset[str]
    """Entities it may report besides the anatomy of a registration; `auto` selects a perceiver by them."""
    entities_with_sd: frozenset[str]
    """Those for which `Observation.certainty` holds; a relation of no other may have a margin."""
    images: ImageKind
    """What it processes: "eye" (before a camera), "bscan" or "volume"."""

    def __call__(self, registration: Any, config: Any) -> Perceiver:
        """Make a perceiver from a registration, frontal to the eye, and the [perception] settings."""
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
    """Turn a state into haptic output."""

    def __call__(self, conclusion: Conclusion) -> HapticCommand:
        """Choose the pattern and when it began."""
        ...

    def reset(self) -> None:
        """Forget what is playing."""
        ...


@runtime_checkable
class Device(Protocol):
    """Drive one actuator. Called only by the guard."""

    capabilities: Capabilities
    """What the device can do; known once it is open."""

    def set(self, amplitude: float, frequency_hz: float, stamp_ns: int) -> None:
        """Vibrate like this until the next call or for `capabilities.holds_ms`; 0 is silence.

        The first call is silence, which ends whatever the device did before.

        Args:
            amplitude: Strength in [0, 1].
            frequency_hz: Frequency, if the device can choose it.
            stamp_ns: When the output is due.

        Raises:
            DeviceError: If the device fails.
        """
        ...

    def close(self) -> None:
        """Silence and release the device. May be called twice.

        Raises:
            DeviceError: If it may still vibrate.
        """
        ...


@runtime_checkable
class RobotReadings(Protocol):
    """Read a robot beside the images."""

    def take(self) -> tuple[RobotSample, ...]:
        """Return its measurements since the last call, oldest first."""
        ...

    def take_faults(self) -> tuple[Fault, ...]:
        """Return the faults since the last call."""
        ...

    def close(self) -> None:
        """Disconnect. May be called twice."""
        ...


@runtime_checkable
class ForceReadings(Protocol):
    """Read what a force device does beside the images."""

    def take(self) -> tuple[ForceSample, ...]:
        """Return what it did since the last call, oldest first."""
        ...

    def summary(self) -> str:
        """Return how it ran, in one line."""
        ...


@runtime_checkable
class Sink(Protocol):
    """Consume every step. Must not block in real time: what does not fit is dropped and counted."""

    dropped: int
    """Items lost so far."""

    def write(self, capture: Capture, step: Step) -> None:
        """Take one step and its capture; after Ctrl-C the last one may come twice."""
        ...

    def take_faults(self) -> tuple[Fault, ...]:
        """Return the faults since the last call."""
        ...

    def close(self) -> None:
        """Finish writing. May be called twice."""
        ...


def check_members(part: object, contract: type, name: str) -> None:
    """Check that an object has every member of one of the Protocols above.

    Args:
        part: The object; haptigraph's own always pass, a user's may not.
        contract: The Protocol.
        name: Of the object, for the error.

    Raises:
        BadInput: If it lacks any.
    """
    methods = {key for key, member in vars(contract).items() if callable(member)}
    members = {key for key in methods | {*contract.__annotations__} if not key.startswith("_")}
    lacking = sorted(key for key in members if not hasattr(part, key))
    if lacking:
        raise BadInput(
            f"{name} lacks {', '.join(lacking)}; define what haptigraph.stages.{contract.__name__} lists"
        )
