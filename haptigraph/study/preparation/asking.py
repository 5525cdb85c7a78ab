"""A participant's task of the calibration on a device: the next stimulus, and the row of a response."""

from collections.abc import Mapping, Sequence

from msgspec import Struct
from msgspec.structs import replace

from haptigraph.config import HapticsConfig
from haptigraph.errors import BadInput
from haptigraph.haptics.pattern import with_weakest
from haptigraph.messages import Pattern
from haptigraph.study.preparation.calibration import Calibration, Response, Stimulus, Task, next_stimulus
from haptigraph.study.preparation.strength import strength_of

__all__ = ["Asking"]


class Asking(Struct, frozen=True):
    """A task that is under way."""

    task: Task
    calibration: Calibration
    patterns: Sequence[Pattern]
    """Of the calibrated condition's procedure."""
    responses: Mapping[tuple[Task, str], Sequence[Response]]
    """So far, by task and device; in order."""
    base: HapticsConfig
    """Device and limits of the station."""
    key: tuple[int, int]
    """The study's seed and the participant's slot."""

    def stimulus(self, more: Sequence[Response] = ()) -> Stimulus | None:
        """Return the next stimulus, as the guard lets it through; None if the task is complete.

        Args:
            more: Responses after those so far.
        """
        measured = self.responses.get(("threshold", self.base.device), ())
        weakest = strength_of(self.calibration, self.patterns, measured, self.base).weakest_amplitude
        given = [*self.responses.get((self.task, self.base.device), ()), *more]
        patterns = with_weakest(self.patterns, weakest)
        stimulus = next_stimulus(self.task, self.calibration, patterns, given, self.key)
        if stimulus is None:
            return None
        amplitude = min(stimulus.pattern.amplitude, self.base.max_amplitude)
        return replace(stimulus, pattern=replace(stimulus.pattern, amplitude=amplitude))

    def respond(self, number: int, response: str) -> tuple[dict[str, object], bool]:
        """Return the row of the response to a stimulus, and whether it completes the task.

        Raises:
            BadInput: If another stimulus comes next, or there is no such response.
        """
        stimulus = self.stimulus()
        if stimulus is None or stimulus.number != number:
            found = f"stimulus {stimulus.number}" if stimulus else "none"
            raise BadInput(f"calibration: stimulus {number} does not come next, but {found}")
        if response not in stimulus.choices:
            raise BadInput(f"calibration: expected {', '.join(stimulus.choices)}; found {response[:40]!r}")
        name = stimulus.pattern.name if self.task == "patterns" else ""
        given = Response(name, stimulus.pattern.amplitude, response)
        row = {
            "task": self.task,
            "device": self.base.device,
            "number": number,
            "round": stimulus.round,
            "pattern": given.pattern or None,
            "amplitude": given.amplitude,
            "response": response,
            "correct": int(given.is_correct),
        }
        return row, self.stimulus([given]) is None
