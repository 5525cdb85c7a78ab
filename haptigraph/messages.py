"""The messages that stages exchange, in the order in which one image becomes touch.

    Capture -> Observation -> SceneGraph -> Conclusion -> HapticCommand,   all of it: Step

Frozen msgspec structs: compared, copied and written as JSON without further code. They hold no behaviour.
All stamps are nanoseconds of one monotonic clock.
"""

from typing import Literal, TypeAlias

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from haptigraph.geometry import Geometry, Vec
from haptigraph.graph import SceneGraph, Triplet

__all__ = [
    "OFF",
    "UNKNOWN",
    "CameraStamp",
    "Capabilities",
    "Capture",
    "Certainty",
    "Conclusion",
    "Fault",
    "Follow",
    "HandState",
    "HapticCommand",
    "Image",
    "Observation",
    "Pattern",
    "Step",
    "Timing",
    "Truth",
]

Image: TypeAlias = NDArray[np.uint8]
"""A picture: (h, w, 3) in OpenCV's BGR order, or (h, w) grey."""

UNKNOWN = "unknown"
"""The state of not seeing a needle: failed detection, stale image, lost camera, dead perceiver."""


class Fault(Struct, frozen=True):
    """Something that went wrong and that the loop survived."""

    where: Literal["source", "perceiver", "guard", "device", "recorder", "bridge"]
    message: str


class Truth(Struct, frozen=True):
    """What a simulator knows about its image. Recorded and scored, never read by a stage.

    The one exception says so in every result: `study.known`.
    """

    visible: bool
    """Whether the tip can be seen (not while it passes the wall)."""
    inside: bool
    tip_px: Vec
    tip_mm: Vec
    depth_mm: float
    """From the trocar's pivot to the tip; negative outside. In a B-scan: below the ILM, down the beam."""
    theta_deg: float
    """Angle between the shaft and the line trocar -> target. In a B-scan: and the horizontal."""
    others: dict[str, Geometry] = {}
    """Where everything else is that moves or may be looked for, by entity name, eye frame."""


class HandState(Struct, frozen=True):
    """What a hand that steers the simulated robot did since the image before, and what came of it."""

    engaged: bool
    """Whether the clutch held; without it the needle does not move."""
    along_mm: float
    """Motion of the hand into the eye."""
    across_mm: float
    """Motion of the hand to the surgeon's right."""
    asked_along_mm: float
    """Motion asked of the tool: with tremor, filtered, scaled, before the robot's limits."""
    asked_across_mm: float
    motion_scale: float
    """Tool motion over hand motion."""
    tremor_filter: bool
    added_tremor_mm: float
    """Strength (RMS) of the simulated tremor of the hand, per axis."""
    apart_mm: float = 0.0
    """How far thumb and finger of the hand went apart; 0 where the tool has no jaws."""
    asked_apart_mm: float = 0.0
    """Motion asked of the jaws: scaled, before the robot's limits."""


class CameraStamp(Struct, frozen=True):
    """When a camera itself says that it took an image; `Capture.stamp_ns` was made from it if it can be."""

    clock: str
    """Whose clock: "global" (the camera's, in this machine's time since 1970), "hardware" (the camera's, from
    any zero), "system" (this machine's, since 1970), "driver" (this machine's monotonic one), "ros" (the
    publisher's, usually since 1970)."""
    stamp_ns: int
    """On that clock, as it came."""
    arrived_ns: int | None = None
    """When the image reached haptigraph, on the run's clock; None if it came from a file."""


class Capture(Struct, frozen=True, eq=False):
    """One tick of input: an image, or the fact that there is none."""

    index: int
    """Number of the image in its source, from 0; missing images (stale, lost) repeat the last one."""
    stamp_ns: int
    """When it was captured."""
    image: Image | None
    encoded: bytes | None = None
    """The JPEG or PNG bytes that `image` was decoded from, where there were any."""
    faults: tuple[Fault, ...] = ()
    """What went wrong outside the pipeline since the capture before."""
    truth: Truth | None = None
    hand: HandState | None = None
    """Where a hand steers the phantom."""
    camera: CameraStamp | None = None
    """Where a camera stamps its images itself."""
    phase: str = ""
    """The phase of the operation, as a person or a script says it; empty: nobody does."""
    phase_s: float = 0.0
    """How long it has been going on."""


class Certainty(Struct, frozen=True):
    """How sure a perceiver is of the needle."""

    confidence: float
    """Share of the visible shaft, up to its tip, that shows both edges on one line."""
    tip_sd_mm: float
    """Standard deviation of the tip."""
    theta_sd_deg: float
    """Standard deviation of the shaft's angle."""


class Observation(Struct, frozen=True):
    """Where things are, in the eye frame. An entity that was not found is not there: never a guess."""

    stamp_ns: int
    found: dict[str, Geometry] = {}
    """Shape by entity name."""
    faults: tuple[Fault, ...] = ()
    certainty: Certainty | None = None
    """Of the needle, where there is one and the perceiver can tell."""
    interpolated: dict[str, tuple[Vec, ...]] = {}
    """Parts of surfaces that were not seen but bridged: from where to where (x, eye frame, mm), by name."""


class Conclusion(Struct, frozen=True):
    """The surgical state, the rule that says so, and why."""

    stamp_ns: int
    state: str
    priority: int
    """Place of the fired rule among the rules, 0 first."""
    feel: str
    """Name of the haptic pattern the state asks for."""
    because: str
    """One sentence for people."""
    evidence: tuple[Triplet, ...] = ()
    """The edges that made the rule fire; none while a state is held though its rule no longer fits."""
    measures: dict[str, float] = {}
    """Those measures of the graph that the pattern it feels follows."""


class Follow(Struct, frozen=True, forbid_unknown_fields=True):
    """How one number of a pattern follows a measure of the scene."""

    key: Literal["amplitude", "frequency_hz", "rate_hz"]
    """What follows; `rate_hz` is how often pulses come, made by their pauses."""
    measure: str
    """What it follows, by its name in the graph."""
    start: tuple[float, float]
    """(measure, number): until the measure gets there, the number is this."""
    end: tuple[float, float]
    """(measure, number): from there on, the number is this."""
    curve: float = 1.0
    """Exponent of the way in between; 1 is straight, 2 slow at first."""
    dead_band: float = 0.0
    """A change of the measure that is not followed: its noise."""


class Pattern(Struct, frozen=True, forbid_unknown_fields=True):
    """One word of the haptic grammar."""

    name: str
    kind: Literal["off", "continuous", "pulses", "bursts"]
    """Pulses repeat until something else is felt; bursts play `count` times, once on entry."""
    amplitude: float = 0.0
    """Strength in [0, 1]."""
    frequency_hz: float = 0.0
    """Vibration frequency, for devices that can choose it."""
    on_ms: float = 0.0
    off_ms: float = 0.0
    count: int = 0
    rearm_ms: float = 0.0
    """Bursts play again only if their state was left for so long."""
    follow: tuple[Follow, ...] = ()
    """Numbers that follow a measure; none in a command, which says what they have become."""


OFF = Pattern("off", "off")
"""Silence."""


class HapticCommand(Struct, frozen=True):
    """What the hand feels from now on: a pattern and when it began. Complete in itself."""

    stamp_ns: int
    pattern: Pattern
    since_ns: int


class Capabilities(Struct, frozen=True):
    """What a haptic device can do of a pattern."""

    amplitude_levels: int
    """Distinct strengths besides silence; 1 means on or off."""
    frequency_range_hz: tuple[float, float] | None
    """Frequencies it can choose, or None when it has but one."""
    shortest_on_ms: float
    """Shorter bursts are not felt."""
    max_rate_hz: float | None = None
    """Changes per second it takes, but for silence, which it always takes; None: all that come."""
    holds_ms: float | None = None
    """It falls silent by itself so long after it was last told, so the guard tells it again in time; None: it
    vibrates until told otherwise."""
    answers: bool = False
    """Whether it confirms what it was told, so that telling it takes one round trip."""
    limitations: str = ""
    """What it does with what it cannot, in one sentence."""


class Timing(Struct, frozen=True):
    """When things happened, on the run's clock. Not part of what a replay compares."""

    processed_ns: int
    """The conclusion was reached."""
    commanded_ns: int
    """The command was handed to the device."""
    stage_ns: dict[str, int]
    """Duration of each stage."""


class Step(Struct, frozen=True):
    """One turn of the loop. What is recorded, replayed, drawn, tested and counted."""

    index: int
    stamp_ns: int
    observation: Observation
    graph: SceneGraph
    conclusion: Conclusion
    command: HapticCommand
    timing: Timing | None = None
    """Added by `Pipeline.run`; None straight out of `Pipeline.step`."""

    @property
    def faults(self) -> tuple[Fault, ...]:
        """What went wrong in or before this step."""
        return self.observation.faults
