"""The haptic output of a run with a force device: every step goes to the vibration and to the hand."""

from collections import deque
from collections.abc import Callable
from typing import Protocol

from haptigraph.errors import DeviceError
from haptigraph.haptics.force.fixture import fixtures_of, tip_of
from haptigraph.haptics.force.hand import ForceHand
from haptigraph.haptics.force.messages import ForceInput
from haptigraph.haptics.force.process import ForceProcess
from haptigraph.messages import Fault, Step
from haptigraph.robot.pose import Vec3

__all__ = ["ForceOutput", "Vibration"]

NOWHERE: Vec3 = (0.0, 0.0, 0.0)


class Vibration(Protocol):
    """The other haptic output of a run: the guard, alone or driven by its player."""

    @property
    def is_silent(self) -> bool:
        """Whether it is closed and silent."""
        ...

    def send(self, step: Step, now_ns: int) -> None:
        """Take the newest step."""
        ...

    def take_faults(self) -> tuple[Fault, ...]:
        """Return the faults since the last call."""
        ...

    def close(self) -> None:
        """Silence it."""
        ...


class ForceOutput:
    """Pass every step on to the force device's process, and to the vibration.

    Args:
        process: The force device; closed with this object.
        vibration: The other output; closed too.
        scale: Returns the ratio of tip motion to hand motion.
        hand: What steers; None if nothing is steered.
        is_off: Whether no force is to be exerted; the hand still steers.
    """

    def __init__(
        self,
        process: ForceProcess,
        vibration: Vibration,
        scale: Callable[[], float],
        *,
        hand: ForceHand | None = None,
        is_off: bool = False,
    ) -> None:
        self._process, self._vibration, self._scale = process, vibration, scale
        self._hand, self._is_off = hand, is_off
        self._faults: deque[Fault] = deque()

    @property
    def is_silent(self) -> bool:
        """Whether vibration is silent, and the force device has let go."""
        return self._vibration.is_silent and self._process.has_let_go

    def send(self, step: Step, now_ns: int) -> None:
        """Take the newest step; does not block."""
        if self._hand is not None:
            self._hand.see(step)
        tip_mm = tip_of(step)
        fixtures = () if tip_mm is None or self._is_off else fixtures_of(step)
        self._process.send(ForceInput(fixtures, tip_mm or NOWHERE, step.stamp_ns, self._scale()))
        self._vibration.send(step, now_ns)

    def take_faults(self) -> tuple[Fault, ...]:
        """Return the faults since the last call."""
        problems = (Fault("force", problem) for problem in self._process.take_problems())
        own = (self._faults.popleft() for _ in range(len(self._faults)))
        return *problems, *own, *self._vibration.take_faults()

    def close(self) -> None:
        """Let go of the hand, and silence the vibration."""
        try:
            self._process.close()
        except DeviceError as error:
            self._faults.append(Fault("force", str(error)))
        finally:
            self._vibration.close()
