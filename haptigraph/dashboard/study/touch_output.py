"""The haptic outputs of a station, its device and its participant's page, and their test pulse.

A trial with haptic feedback needs an output whose pulse the participant felt in the same session. Where
conditions are hidden from somebody, so does every trial of a study with haptic feedback; otherwise the test
would reveal it.
"""

from collections.abc import Callable, Sequence

from msgspec.structs import replace
from sqlalchemy import select

from haptigraph.clock import MonotonicClock
from haptigraph.config import HapticsConfig
from haptigraph.dashboard.server.viewer import Viewer
from haptigraph.dashboard.study.stimulus import Stimulus, play_stimulus
from haptigraph.errors import BadInput
from haptigraph.haptics.observed_device import Listener, is_felt
from haptigraph.messages import Pattern
from haptigraph.study.plan import Stage
from haptigraph.study.progress import of_participant
from haptigraph.study.protocol import Protocol
from haptigraph.study.runner import Session
from haptigraph.study.tables import EVENTS

__all__ = ["TouchOutput"]

PULSE = Stimulus("test pulse", Pattern("test pulse", "bursts", 1.0, 160.0, 120.0, 120.0, 3))
"""Bursts that are long enough for the motor of a controller."""
NO_OUTPUT = (
    "there is no haptic output; connect a game controller and press one of its buttons, or switch on screen "
    "or sound under Set up on the participant's page"
)
NOT_FELT = (
    "the haptic output is not confirmed; the participant presses Test pulse, and says whether it was felt"
)
CHANGED = "the haptic output has changed since the last test pulse; the participant tests it again"


class TouchOutput:
    """The outputs that a participant can feel at one station.

    Args:
        config: Device and limits.
        viewers: All pages; those of participants name their outputs.
        listener: Receives every level of the test pulse, for the pages.
        sent: Called with the time of every command, which keeps the level on the pages alive.
    """

    def __init__(
        self,
        config: HapticsConfig,
        viewers: Sequence[Viewer],
        listener: Listener,
        sent: Callable[[int], None],
    ) -> None:
        self._config, self._viewers, self._listener, self._sent = config, viewers, listener, sent
        self._pulsed: tuple[str, int, str] | None = None
        """Participant, session and outputs of a test pulse that is not answered yet."""

    @property
    def name(self) -> str:
        """All outputs, joined by " + "; empty: none, so that nothing can be felt."""
        if not self._config.max_amplitude:
            return ""
        pages = {output for viewer in tuple(self._viewers) for output in viewer.outputs}
        device = self._config.device
        return " + ".join([*([device] if is_felt(device) else []), *sorted(pages)])

    def checked_name(self) -> str:
        """Return all outputs.

        Raises:
            BadInput: If there is none.
        """
        if not self.name:
            raise BadInput(NO_OUTPUT)
        return self.name

    def problem(self, session: Session, stage: Stage) -> str:
        """Describe why a trial must not begin; return "" if it may, or if the stage is none."""
        if not _needs_output(session.study.protocol, stage):
            return ""
        felt = _felt_output(session)
        if not self.name:
            return NO_OUTPUT
        return "" if felt == self.name else CHANGED if felt else NOT_FELT

    def play(self, session: Session) -> None:
        """Play the test pulse, within the limits of the guard.

        Raises:
            BadInput: If there is no output, or the device cannot be opened.
            DeviceError: If the device failed.
            NotSilent: If it may still vibrate.
        """
        name, device = self.checked_name(), self._config.device
        config = replace(self._config, device=device if is_felt(device) else "console")
        play_stimulus(PULSE, config, MonotonicClock(), self._listener, self._sent)
        self._pulsed = session.participant, session.number, name

    def answer(self, session: Session, *, is_felt: bool) -> None:
        """Store whether the participant felt the test pulse.

        Raises:
            BadInput: If none was played, or the outputs have changed since.
        """
        pulsed, self._pulsed = self._pulsed, None
        if pulsed is None or pulsed[:2] != (session.participant, session.number):
            raise BadInput("no test pulse was played yet; press Test pulse first")
        if pulsed[2] != self.name:
            raise BadInput("the haptic output changed during the test; press Test pulse again")
        session.answer_pulse(pulsed[2], is_felt=is_felt)


def _needs_output(protocol: Protocol, stage: Stage) -> bool:
    """Return whether a stage needs an output whose test pulse was felt."""
    if not stage.is_trial:
        return False
    if protocol.study.blind == "nobody":
        return bool(protocol.condition(stage.condition).touch)
    return any(condition.touch for condition in protocol.conditions)


def _felt_output(session: Session) -> str:
    """Return the outputs whose pulse was felt in this session; empty: none, or the last was not felt."""
    mine = of_participant(EVENTS, session.study.name, session.participant)
    query = select(EVENTS.c.kind, EVENTS.c.text).where(
        *mine, EVENTS.c.session == session.number, EVENTS.c.kind.in_(("felt", "unfelt"))
    )
    answers = session.study.store.rows(query.order_by(EVENTS.c.number))
    return answers[-1]["text"] if answers and answers[-1]["kind"] == "felt" else ""
