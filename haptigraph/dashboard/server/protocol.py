"""What page and server say to each other. docs/dashboard.md describes every message.

Knows how things are written down, not when they are sent.
"""

from typing import Annotated, Any, TypeAlias

import msgspec
from msgspec import UNSET, Meta, Struct, UnsetType, structs

from haptigraph.geometry import Geometry
from haptigraph.graph import Names
from haptigraph.messages import HandState, Step
from haptigraph.teleop.motion import HandMotion, MotionScale, TremorMm

__all__ = [
    "Ack",
    "Enter",
    "Heard",
    "Motion",
    "Ping",
    "Release",
    "Shown",
    "Take",
    "Tune",
    "Watch",
    "heard",
    "packed",
    "shown",
    "told",
]

Count = Annotated[int, Meta(ge=0, le=2**53)]


class Ack(Struct, tag="ack", frozen=True, forbid_unknown_fields=True):
    """An image has arrived."""

    number: Count


class Watch(Struct, tag="watch", frozen=True, forbid_unknown_fields=True):
    """Whether images are wanted: not while the tab is hidden."""

    images: bool


class Ping(Struct, tag="ping", frozen=True, forbid_unknown_fields=True):
    """What time is it? `time_ms` comes back as it was."""

    time_ms: float


class Take(Struct, tag="take", frozen=True, forbid_unknown_fields=True):
    """Give me the controls."""


class Release(Struct, tag="release", frozen=True, forbid_unknown_fields=True):
    """Anyone else may have the controls."""


class Motion(Struct, tag="motion", frozen=True, forbid_unknown_fields=True):
    """What the hand did since the last such message."""

    hand: HandMotion


class Tune(Struct, tag="tune", frozen=True, forbid_unknown_fields=True):
    """How the motion of the hand shall become motion of the tool: what changes of `TeleopSettings`.

    Only that, because a page that sent the rest as well would take back what it has not yet been told.
    """

    motion_scale: MotionScale | UnsetType = UNSET
    tremor_filter: bool | UnsetType = UNSET
    added_tremor_mm: TremorMm | UnsetType = UNSET

    def changes(self) -> dict[str, float | bool]:
        """Return the settings that change, by name."""
        return {name: value for name, value in structs.asdict(self).items() if value is not UNSET}


class Enter(Struct, tag="enter", frozen=True, forbid_unknown_fields=True):
    """The operation enters a phase."""

    phase: str


Heard: TypeAlias = Ack | Watch | Ping | Take | Release | Motion | Tune | Enter
"""What a page may say."""

_DECODER = msgspec.json.Decoder(Heard)


class Shown(Struct, frozen=True, tag="image"):
    """One step, as the page needs it; travels in front of the picture."""

    number: int
    """Of this message, for the page's `ack`."""
    index: int
    time_ms: float
    """When the image was captured, on the server's clock."""
    commanded_ms: float
    """When the hand was told."""
    state: str
    because: str
    feel: str
    """The pattern the state asks for."""
    plays: str
    """The pattern that is commanded."""
    evidence: tuple[Names, ...]
    nodes: tuple[str, ...]
    edges: tuple[Names, ...]
    measures: dict[str, float]
    found: dict[str, Geometry]
    """Shapes of the moving entities by name, eye frame."""
    faults: tuple[str, ...]
    has_picture: bool
    hand: HandState | None
    """What the hand that steers did for this image."""


def heard(text: str) -> Heard:
    """Read what a page says.

    Raises:
        ValueError: If it is no such message; the sentence says why.
    """
    try:
        message: Heard = _DECODER.decode(text)
    except msgspec.MsgspecError as error:
        raise ValueError(str(error)) from None
    except RecursionError:
        raise ValueError("nested too deeply") from None
    return message


def told(kind: str, **content: Any) -> str:
    """Write a message that goes as text: {"type": kind, ...}."""
    return msgspec.json.encode({"type": kind, **content}).decode()


def packed(header: Shown, picture: bytes) -> bytes:
    """Write an image message: length of the JSON (4 bytes, big-endian), JSON, JPEG."""
    text = msgspec.json.encode(header)
    return len(text).to_bytes(4, "big") + text + picture


def shown(step: Step, moving: frozenset[str], **more: Any) -> Shown:
    """Say a step as the page needs it.

    Args:
        step: The step.
        moving: Names of the entities to tell; the page knows the others.
        more: The other fields of `Shown`.
    """
    conclusion, graph = step.conclusion, step.graph
    return Shown(
        index=step.index,
        state=conclusion.state,
        because=conclusion.because,
        feel=conclusion.feel,
        plays=step.command.pattern.name,
        evidence=tuple((edge.subject, edge.predicate, edge.object) for edge in conclusion.evidence),
        nodes=tuple(node.id for node in graph.nodes),
        edges=tuple((edge.subject, edge.predicate, edge.object) for edge in graph.edges),
        measures=graph.measures,
        found={name: shape for name, shape in step.observation.found.items() if name in moving},
        faults=tuple(f"{fault.where}: {fault.message}" for fault in step.faults),
        **more,
    )
