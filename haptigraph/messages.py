"""The messages that stages exchange, in the order in which one image becomes haptic output.

    Capture -> Observation -> SceneGraph -> Conclusion -> HapticCommand,   all of it: Step

Frozen msgspec structs without behaviour: compared, copied and written as JSON as they are. All stamps are
nanoseconds of one monotonic clock.
"""

from typing import Literal, TypeAlias

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from haptigraph.display import ShownAsHtml
from haptigraph.geometry import Geometry, Vec
from haptigraph.grammar import OFF, Follow, ForceField, Pattern
from haptigraph.graph import SceneGraph, Triplet
from haptigraph.projection import DepthImage

__all__ = [
    "CERTAIN", "OFF", "STALE_IMAGE", "TIP_NOT_VISIBLE", "UNKNOWN", "CameraStamp", "Capabilities",
    "Capture", "Certainty", "Conclusion", "Delivered", "DepthImage", "Fault", "Follow", "ForceField",
    "ForceSample", "HandState", "HapticCommand", "Image", "ImageKind", "Observation", "Pattern",
    "RobotSample", "Step", "Timing", "Truth", "Volume", "reason",
]  # fmt: skip

Image: TypeAlias = NDArray[np.uint8]
"""An image: (h, w, 3) in OpenCV's BGR order, or (h, w) grey."""

Volume: TypeAlias = NDArray[np.uint8]
"""A volume of OCT: (rows, slices, columns), grey. It travels as an image of its B-scans side by side,
(rows, slices * columns)."""

ImageKind: TypeAlias = Literal["eye", "bscan", "volume"]
"""What an image shows: an eye before a camera, a B-scan, or the B-scans of a volume."""

UNKNOWN = "unknown"
"""The state without a detected needle: failed detection, stale image, lost camera, dead perceiver."""
TIP_NOT_VISIBLE = "tip_not_visible"
"""The state of a needle whose shaft is detected, but not its tip."""

STALE_IMAGE = "stale image"
"""Beginning of a source's fault that no new image came in time."""

FaultyPart: TypeAlias = Literal[
    "source", "registration", "perceiver", "guard", "device", "force", "recorder", "bridge", "leader", "robot"
]


class Fault(Struct, frozen=True, omit_defaults=True):
    """An error that the loop survived, or the end of one."""

    where: FaultyPart
    message: str
    is_over: bool = False
    """Whether an error of this part has ended; the message says how."""

    def __str__(self) -> str:
        return f"{self.where}: {self.message}"


class Truth(Struct, frozen=True):
    """A simulator's ground truth of one image. Recorded and scored, never read by a stage.

    The one exception is a simulated study without images, whose results say so.
    """

    visible: bool
    """Whether the tip is visible (not while it passes the wall)."""
    inside: bool
    tip_px: Vec
    tip_mm: Vec
    depth_mm: float
    """From the trocar's remote centre of motion to the tip; negative outside. In a B-scan: from the ILM along
    the beam."""
    theta_deg: float
    """Angle between the shaft and the line trocar -> target; in a B-scan, the horizontal."""
    others: dict[str, Geometry] = {}
    """Geometry of all other entities that move or may be detected, by name; eye frame."""


class HandState(Struct, frozen=True):
    """Motion of the hand that steers the simulated robot since the previous image, and its effect."""

    engaged: bool
    """Whether the clutch was engaged; otherwise the needle does not move."""
    along_mm: float
    """Motion of the hand into the eye."""
    across_mm: float
    """Motion of the hand to the surgeon's right."""
    asked_along_mm: float
    """Motion requested of the tool: with tremor, filtered, scaled, before the robot's limits."""
    asked_across_mm: float
    motion_scale: float
    """Ratio of tool motion to hand motion."""
    tremor_filter: bool
    added_tremor_mm: float
    """RMS amplitude of the simulated hand tremor, per axis."""
    apart_mm: float = 0.0
    """Opening motion of the operator's thumb and finger; 0 if the tool has no jaws."""
    asked_apart_mm: float = 0.0
    """Opening motion requested of the jaws: scaled, before the robot's limits."""
    outwards_mm: float = 0.0
    """Motion of the hand across the section, towards the camera; a planar robot does not follow it."""
    asked_outwards_mm: float = 0.0
    """Motion requested of the tool in that direction."""


class CameraStamp(Struct, frozen=True):
    """A camera's own time stamp of an image; `Capture.stamp_ns` is derived from it if possible."""

    clock: str
    """The clock: "global" (the camera's, converted to this machine's time since 1970), "hardware" (the
    camera's, with an arbitrary zero), "system" (this machine's, since 1970), "driver" (this machine's
    monotonic one), "ros" (the publisher's, usually since 1970)."""
    stamp_ns: int
    """On that clock, unchanged."""
    arrived_ns: int | None = None
    """When haptigraph received the image, on the run's clock; None for a file."""


class Delivered(Struct, frozen=True):
    """A period for which an output confirmed that it vibrated, on the run's clock."""

    start_ns: int
    end_ns: int
    output: str


class RobotSample(Struct, frozen=True):
    """One measurement of the robot that holds the instrument."""

    stamp_ns: int
    """When the pose was measured, on the run's clock."""
    position_mm: tuple[float, float, float]
    """The tip, in the robot's base."""
    quaternion: tuple[float, float, float, float]
    """From the tool's frame to the robot's base: x, y, z, w."""
    operating: str = ""
    """Operating state, as CRTK names it; empty: not reported."""
    force_n: tuple[float, float, float] | None = None
    """Force on the tool, in the robot's base; None: not reported."""
    eye_tip_mm: tuple[float, float, float] | None = None
    """The tip in the eye frame; None: the robot is not calibrated."""
    eye_tip_sd_mm: float | None = None
    """Standard deviation of `eye_tip_mm` per axis; None: unknown."""


class ForceSample(Struct, frozen=True):
    """What a force device did to the hand: axes x to its right, y up, z towards the operator."""

    stamp_ns: int
    """On the run's clock."""
    hand_mm: tuple[float, float, float]
    """Where the hand was."""
    force_n: tuple[float, float, float]
    """The force that the device was commanded to exert on it."""
    is_engaged: bool
    """Whether the operator held the clutch."""


class Capture(Struct, frozen=True, eq=False):
    """One tick of input: an image, or the fact that there is none."""

    index: int
    """Number of the image in its source, from 0; captures without image repeat the last number."""
    stamp_ns: int
    """When it was captured."""
    image: Image | None
    encoded: bytes | None = None
    """The JPEG or PNG bytes that `image` was decoded from, if any."""
    faults: tuple[Fault, ...] = ()
    """Faults outside the pipeline since the previous capture."""
    truth: Truth | None = None
    hand: HandState | None = None
    """Set if the phantom is teleoperated."""
    camera: CameraStamp | None = None
    """Set if the camera stamps its images."""
    phase: str = ""
    """The phase of the operation, as set by a person or a script; empty: none."""
    phase_s: float = 0.0
    """Time since the phase began."""
    delivered: tuple[Delivered, ...] = ()
    """Vibration that an output has confirmed since the previous capture; periods may overlap."""
    robot: tuple[RobotSample, ...] = ()
    """Measurements of the robot since the previous capture, oldest first."""
    force: tuple[ForceSample, ...] = ()
    """What the force device did since the previous capture, oldest first."""
    depth: DepthImage | None = None


class Certainty(Struct, frozen=True, omit_defaults=True):
    """Confidence and uncertainty of a perceiver's needle estimate."""

    confidence: float
    """Fraction of the visible shaft, up to its tip, along which both edges support one line."""
    tip_sd_mm: float | None
    """Standard deviation of the tip; None if it is not known where the tip is."""
    theta_sd_deg: float
    """Standard deviation of the shaft's angle."""
    out_of_plane_sd_deg: float | None = None
    """Standard deviation of its angle to the section; None if no depth shows it."""


CERTAIN = Certainty(1.0, 0.0, 0.0)
"""Of a simulator's true needle."""


class Observation(Struct, frozen=True):
    """Geometry of the detected entities, eye frame. What was not detected is left out, never guessed."""

    stamp_ns: int
    found: dict[str, Geometry] = {}
    """Geometry by entity name."""
    faults: tuple[Fault, ...] = ()
    certainty: Certainty | None = None
    """Of the needle, if it was detected and the perceiver estimates it."""
    interpolated: dict[str, tuple[Vec, ...]] = {}
    """Intervals of surfaces that were not observed but interpolated: start and end (x, eye frame, mm)."""
    sd_mm: dict[str, float | tuple[float, ...]] = {}
    """Standard deviations along the beam by entity, besides `certainty`: of a polyline at each vertex, of a
    surface in a volume below the tip."""


class Conclusion(Struct, ShownAsHtml, frozen=True):
    """The surgical state, the rule that fired, and why."""

    stamp_ns: int
    state: str
    priority: int
    """Rank of the fired rule, 0 first."""
    feel: str
    """Name of the state's haptic pattern."""
    because: str
    """One sentence for people."""
    evidence: tuple[Triplet, ...] = ()
    """The edges that made the rule fire; none while a state is held although its rule no longer matches."""
    measures: dict[str, float] = {}
    """The measures of the graph that the pattern follows."""
    forces: tuple[str, ...] = ()
    """Names of the state's force fields."""

    def __repr__(self) -> str:
        return f"<Conclusion {self.state}, feels {self.feel!r}: {self.because}>"


class HapticCommand(Struct, frozen=True):
    """The haptic output from now on: a pattern, when it began, and the force fields. Self-contained."""

    stamp_ns: int
    pattern: Pattern
    since_ns: int
    forces: tuple[ForceField, ...] = ()
    """The force fields that act; where in the eye follows from the step's observation."""


class Capabilities(Struct, frozen=True):
    """What a haptic device can render of a pattern."""

    amplitude_levels: int
    """Number of amplitudes besides silence; 1 means on or off."""
    frequency_range_hz: tuple[float, float] | None
    """Range of selectable frequencies; None: fixed."""
    shortest_on_ms: float
    """Shorter bursts cannot be felt."""
    max_rate_hz: float | None = None
    """Maximum rate of changes, except silence, which is always accepted; None: unlimited."""
    holds_ms: float | None = None
    """The device silences itself after this time, so the guard repeats commands; None: it vibrates until the
    next command."""
    answers: bool = False
    """Whether it confirms each command, so that a command takes one round trip."""
    limitations: str = ""
    """How it renders what it cannot do exactly, in one sentence."""


class Timing(Struct, frozen=True):
    """Time stamps on the run's clock and stage durations. A replay does not compare them."""

    processed_ns: int
    """When the conclusion was reached."""
    commanded_ns: int
    """When the command was passed to the device."""
    stage_ns: dict[str, int]
    """Duration of each stage."""


class Step(Struct, ShownAsHtml, frozen=True):
    """One iteration of the loop: what is recorded, replayed, drawn, tested and counted."""

    index: int
    stamp_ns: int
    observation: Observation
    graph: SceneGraph
    conclusion: Conclusion
    command: HapticCommand
    timing: Timing | None = None
    """Added by `Pipeline.run`; None straight out of `Pipeline.step`."""

    def __repr__(self) -> str:
        state, plays = self.conclusion.state, self.command.pattern.name
        return f"<Step of image {self.index} at {self.stamp_ns / 1e9:.3f} s: {state}, plays {plays!r}>"

    @property
    def faults(self) -> tuple[Fault, ...]:
        """Faults in or before this step, without the ends of earlier ones."""
        return tuple([fault for fault in self.observation.faults if not fault.is_over])


def reason(capture: Capture, step: Step) -> str:
    """Return why a state was concluded, for people; its rule's sentence is true of images alone."""
    has_image = capture.image is not None or capture.encoded is not None
    if has_image or step.conclusion.state != UNKNOWN:
        return step.conclusion.because
    is_lost = any(fault.where == "source" for fault in step.faults)
    return "there is no new image" if is_lost else "the images have ended"
