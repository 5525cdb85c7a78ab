"""The contract of every leader. `opening.LEADERS` lists the classes, `steering` moves a robot by one."""

from collections.abc import Sequence
from typing import Protocol, runtime_checkable

from haptigraph.teleop.motion import HandMotion

__all__ = ["MAX_STEP_MM", "Leader"]

MAX_STEP_MM = 20.0
"""Largest displacement per axis in one motion, whatever a leader reports."""


@runtime_checkable
class Leader(Protocol):
    """Deliver the motion of one hand. Used by one thread; no call blocks."""

    def take(self) -> Sequence[HandMotion]:
        """Return the motions since the last call, oldest first; engaged only while the dead-man is pressed.

        No motion displaces by more than `MAX_STEP_MM` per axis.

        Raises:
            DeviceError: If the leader is lost; the next call tries to reach it again.
        """
        ...

    def close(self) -> None:
        """Release the hardware. May be called twice."""
        ...
