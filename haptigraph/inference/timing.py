"""Check what a procedure says about time: holds that delay alarms, states that must last to be entered."""

from collections.abc import Mapping
from typing import Protocol

from haptigraph.inference.checks import check_name
from haptigraph.inference.meaning import Kind
from haptigraph.toml_document import Document

__all__ = ["Timed", "check_timing"]


class Timed(Protocol):
    """What this module needs to know of a state."""

    @property
    def name(self) -> str:
        """Its name."""

    @property
    def hold_ms(self) -> float:
        """How long it outlasts its rule."""

    @property
    def enter_after_ms(self) -> float:
        """How long its rule must fit before it is entered."""

    @property
    def may_delay(self) -> tuple[str, ...]:
        """Alarms that its hold may delay."""


def check_timing(document: Document, states: tuple[Timed, ...], kinds: Mapping[str, Kind]) -> None:
    """Check times and what they refer to.

    Raises:
        BadInput: If an alarm or the loss of an instrument would wait, or a delay is declared for no alarm.
    """
    alarms = [name for name, kind in kinds.items() if kind == "alarm"]
    for number, state in enumerate(states):
        path = f"state[{number}]"
        if state.enter_after_ms and kinds[state.name] in ("alarm", "unseen"):
            what = "an alarm" if kinds[state.name] == "alarm" else "the loss of what is detected"
            raise document.error(
                f"{what} never waits; remove enter_after_ms from {state.name}", f"{path}.enter_after_ms"
            )
        for name in state.may_delay:
            check_name(document, "alarm", name, alarms, f"{path}.may_delay")
        if state.may_delay and not state.hold_ms:
            raise document.error(f"{state.name} has may_delay without hold_ms", f"{path}.may_delay")
