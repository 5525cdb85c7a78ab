"""The messages between page and server, and their encoding; see docs/reference/pages.md."""

from typing import Annotated, Any, TypeAlias

import msgspec
from msgspec import UNSET, Meta, Struct, UnsetType, structs

from haptigraph.analysis.metrics.in_space import in_space_text
from haptigraph.geometry import Geometry
from haptigraph.graph import Names
from haptigraph.messages import Capture, HandState, Step, reason
from haptigraph.perception.eye_view import EyeView
from haptigraph.teleop.motion import HandMotion, MotionScale, TremorMm

__all__ = [
    "Ack",
    "ClientMessage",
    "EnterPhase",
    "ImageHeader",
    "Motion",
    "Outputs",
    "Ping",
    "Played",
    "ReleaseControls",
    "SwitchRobot",
    "TakeControls",
    "Tune",
    "Watch",
    "image_header",
    "pack",
    "parse_client_message",
    "text_message",
]

TIP = "needle_tip"
"""The entity whose standard deviation `Certainty` gives; it is not that of open jaws."""
Count = Annotated[int, Meta(ge=0, le=2**53)]
TimeMs = Annotated[float, Meta(ge=0, le=2**53)]
OutputName = Annotated[str, Meta(min_length=1, max_length=120, pattern=r"^[^\x00-\x1f+]*$")]


class Ack(Struct, tag="ack", frozen=True, forbid_unknown_fields=True):
    """An image has arrived."""

    number: Count


class Watch(Struct, tag="watch", frozen=True, forbid_unknown_fields=True):
    """Whether the page wants images; a hidden tab does not."""

    images: bool


class Ping(Struct, tag="ping", frozen=True, forbid_unknown_fields=True):
    """Request for the server's time; `time_ms` is returned unchanged."""

    time_ms: float


class TakeControls(Struct, tag="take_controls", frozen=True, forbid_unknown_fields=True):
    """Request for the controls."""


class ReleaseControls(Struct, tag="release_controls", frozen=True, forbid_unknown_fields=True):
    """The page gives up the controls."""


class Motion(Struct, tag="motion", frozen=True, forbid_unknown_fields=True):
    """Motion of the hand since the last such message."""

    hand: HandMotion
    sent_ms: TimeMs | None = None
    """When, on the server's clock; a robot ignores motion without it."""


class SwitchRobot(Struct, tag="switch_robot", frozen=True, forbid_unknown_fields=True):
    """The enable switch of a robot."""

    on: bool


class Tune(Struct, tag="tune", frozen=True, forbid_unknown_fields=True):
    """Changes of `TeleopSettings`.

    A page sends changes only: if it sent all settings, it could undo a change that it has not received yet.
    """

    motion_scale: MotionScale | UnsetType = UNSET
    tremor_filter: bool | UnsetType = UNSET
    added_tremor_mm: TremorMm | UnsetType = UNSET

    def changes(self) -> dict[str, float | bool]:
        """Return the settings that change, by name."""
        return {name: value for name, value in structs.asdict(self).items() if value is not UNSET}


class EnterPhase(Struct, tag="enter_phase", frozen=True, forbid_unknown_fields=True):
    """The operation enters a phase."""

    phase: str


class Outputs(Struct, tag="outputs", frozen=True, forbid_unknown_fields=True):
    """The page's outputs of haptic feedback that work at present."""

    names: Annotated[tuple[OutputName, ...], Meta(max_length=8)]


class Played(Struct, tag="played", frozen=True, forbid_unknown_fields=True):
    """An output of the page has confirmed that it vibrated, on the server's clock."""

    output: OutputName
    start_ms: TimeMs
    end_ms: TimeMs


ClientMessage: TypeAlias = (
    Ack
    | Watch
    | Ping
    | TakeControls
    | ReleaseControls
    | Motion
    | SwitchRobot
    | Tune
    | EnterPhase
    | Outputs
    | Played
)
"""A message from a page."""

_DECODER = msgspec.json.Decoder(ClientMessage)


class ImageHeader(Struct, frozen=True, tag="image"):
    """One step for the page; precedes the picture."""

    number: int
    """Of this message, for the page's `ack`."""
    index: int
    time_ms: float
    """When the image was captured, on the server's clock."""
    commanded_ms: float
    """When the device was commanded."""
    state: str
    because: str
    feel: str
    """Pattern of the state."""
    plays: str
    """Pattern that is commanded."""
    forces: tuple[str, ...]
    """Force fields that are commanded."""
    evidence: tuple[Names, ...]
    nodes: tuple[str, ...]
    edges: tuple[Names, ...]
    measures: dict[str, float]
    found: dict[str, Geometry]
    """Shapes of the moving entities by name, eye frame; of a volume, in the B-scan through the tip."""
    beside: tuple[dict[str, Geometry], ...]
    """The same in the other pictures of a volume's view, moved to their places in it."""
    sd_mm: dict[str, float]
    """Standard deviations of points by name, where estimated."""
    faults: tuple[str, ...]
    in_space: str
    """How far the needle is out of the section; empty if no depth shows it."""
    has_picture: bool
    hand: HandState | None
    """Of the hand that steers, at this image."""


def parse_client_message(text: str) -> ClientMessage:
    """Parse a message from a page.

    Raises:
        ValueError: If it is invalid, with one sentence that says why.
    """
    try:
        message: ClientMessage = _DECODER.decode(text)
    except msgspec.MsgspecError as error:
        raise ValueError(str(error)) from None
    except RecursionError:
        raise ValueError("nested too deeply") from None
    return message


def text_message(kind: str, **content: Any) -> str:
    """Encode a text message: {"type": kind, ...}."""
    return msgspec.json.encode({"type": kind, **content}).decode()


def pack(content: ImageHeader | dict[str, Any], data: bytes) -> bytes:
    """Encode a binary message: length of the JSON (4 bytes, big-endian), JSON, data."""
    text = msgspec.json.encode(content)
    return len(text).to_bytes(4, "big") + text + data


def image_header(
    capture: Capture, step: Step, moving: frozenset[str], view: EyeView, **more: Any
) -> ImageHeader:
    """Return the header of a step.

    Args:
        capture: What the step was made of.
        step: The step.
        moving: Names of the entities to include; the page has the others already.
        view: The view in which they are drawn.
        more: The other fields of `ImageHeader`.
    """
    conclusion, graph, certainty = step.conclusion, step.graph, step.observation.certainty
    found = {name: shape for name, shape in step.observation.found.items() if name in moving}
    main, *beside = view.drawn(found)
    tip_sd_mm = certainty.tip_sd_mm if certainty and TIP in step.observation.found else None
    return ImageHeader(
        index=step.index,
        state=conclusion.state,
        because=reason(capture, step),
        feel=conclusion.feel,
        plays=step.command.pattern.name,
        forces=tuple(force.name for force in step.command.forces),
        evidence=tuple((edge.subject, edge.predicate, edge.object) for edge in conclusion.evidence),
        nodes=tuple(node.id for node in graph.nodes),
        edges=tuple((edge.subject, edge.predicate, edge.object) for edge in graph.edges),
        measures=graph.measures,
        found=main,
        beside=tuple(beside),
        sd_mm={} if tip_sd_mm is None else {TIP: tip_sd_mm},
        in_space=in_space_text(step.observation),
        faults=tuple(map(str, step.faults)),
        **more,
    )
