"""What the Haply Inverse service sends, version 3.1 of its JSON format; other fields are ignored."""

from msgspec import Struct

__all__ = [
    "GripEntry",
    "GripState",
    "InverseEntry",
    "InverseState",
    "InverseStatus",
    "ServiceMessage",
    "Triple",
]


class Triple(Struct, frozen=True):
    """A vector in Haply's axes, metres or newtons."""

    x: float
    y: float
    z: float


class InverseState(Struct, frozen=True):
    """State of an Inverse3."""

    cursor_position: Triple
    cursor_velocity: Triple
    current_cursor_force: Triple | None = None


class InverseStatus(Struct, frozen=True):
    """Status of an Inverse3; what a version of the service leaves out counts as good."""

    calibrated: bool = True
    ready: bool = True


class InverseEntry(Struct, frozen=True):
    """One Inverse3."""

    device_id: str
    state: InverseState
    status: InverseStatus = InverseStatus()


class GripState(Struct, frozen=True):
    """State of a VerseGrip: the wired one has one button, the wireless one has three."""

    button: bool = False
    buttons: dict[str, bool] = {}


class GripEntry(Struct, frozen=True):
    """One VerseGrip."""

    state: GripState = GripState()


class ServiceMessage(Struct, frozen=True):
    """What the service sends; other fields are ignored."""

    inverse3: list[InverseEntry] = []
    verse_grip: list[GripEntry] = []
    wireless_verse_grip: list[GripEntry] = []

    @property
    def grips(self) -> list[GripEntry]:
        """The VerseGrips."""
        return [*self.verse_grip, *self.wireless_verse_grip]
