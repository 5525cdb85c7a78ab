"""The calibration of a participant's hand: from the answers so far to the next stimulus. Pure.

Two tasks. `threshold`: "Did you feel it?", at amplitudes that approach the detection threshold. `patterns`:
"Which one was it?", each pattern of the procedure equally often, in an order drawn from the study's seed.
"""

from collections.abc import Mapping, Sequence
from typing import Annotated, Literal, TypeAlias

from msgspec import Meta, Struct
from msgspec.structs import replace

from haptigraph.errors import unknown_name
from haptigraph.haptics.pattern import amplitude_range
from haptigraph.haptics.profiles.threshold import (
    Answered,
    Threshold,
    estimate_threshold,
    is_catch,
    next_amplitude,
)
from haptigraph.messages import Pattern
from haptigraph.study.conditions import shuffled
from haptigraph.toml_document import Document

__all__ = [
    "FELT",
    "NOT_FELT",
    "Calibration",
    "Response",
    "Stimulus",
    "Task",
    "checked_calibration",
    "next_stimulus",
    "threshold_of",
    "vibrating",
]

Task: TypeAlias = Literal["threshold", "patterns"]
FELT, NOT_FELT = "felt", "not felt"
MIN_STIMULI = 20
ON_MS = 500.0  # of a stimulus of the threshold


class Calibration(Struct, frozen=True, forbid_unknown_fields=True):
    """The [calibration] table; without it there is no calibration."""

    condition: str = ""
    """The condition whose patterns are used; empty: the first with haptic output."""
    stimuli: Annotated[int, Meta(ge=0, le=200)] = 40
    """Stimuli of the threshold, one in five of them silent; 0: no threshold."""
    presentations: Annotated[int, Meta(ge=0, le=20)] = 5
    """How often each pattern is presented in a round; 0: no test of the patterns."""
    max_rounds: Annotated[int, Meta(ge=1, le=10)] = 1
    """Rounds end after this many, or after the first in which every pattern was named correctly."""
    times_threshold: Annotated[float, Meta(ge=0, le=100)] = 0.0
    """Amplitude of the weakest pattern in trials, relative to the threshold; 0: as in the procedure."""

    @property
    def tasks(self) -> list[Task]:
        """What is measured, in order."""
        counts: tuple[tuple[Task, int], ...] = (("threshold", self.stimuli), ("patterns", self.presentations))
        return [task for task, count in counts if count]


class Response(Struct, frozen=True):
    """One stimulus and the participant's response."""

    pattern: str
    """Empty: a stimulus of the threshold."""
    amplitude: float
    """0: silence, a catch trial."""
    response: str

    @property
    def is_correct(self) -> bool:
        """Whether a pattern was named, a vibration felt, or silence not felt."""
        if self.pattern:
            return self.response == self.pattern
        return self.response == (FELT if self.amplitude else NOT_FELT)


class Stimulus(Struct, frozen=True):
    """The next stimulus of a task."""

    number: int
    """From 1, over all rounds."""
    of: int
    """Number of stimuli until the end of the task, or of the round."""
    round: int
    """From 1."""
    pattern: Pattern
    choices: tuple[str, ...]
    """The possible responses."""
    patterns: tuple[Pattern, ...] = ()
    """The patterns that may be played; empty in the threshold's task."""
    is_first: bool = False
    """Whether it begins a round."""


def checked_calibration(
    document: Document, calibration: Calibration, patterns: Mapping[str, Sequence[Pattern]]
) -> Calibration:
    """Check the table of a protocol, and fill in its condition.

    Args:
        document: The protocol, for errors.
        calibration: The table.
        patterns: Of the procedure of each condition with haptic output, in order.

    Raises:
        BadInput: If it cannot be used, with what would be valid.
    """
    if not patterns:
        raise document.error("no condition has haptic output to calibrate; remove the table", "calibration")
    name = calibration.condition or next(iter(patterns))
    if name not in patterns:
        problem = unknown_name("condition with haptic output", name, patterns)
        raise document.error(problem, "calibration.condition")
    if not calibration.tasks:
        raise document.error("stimuli and presentations are both 0; remove the table", "calibration")
    if 0 < calibration.stimuli < MIN_STIMULI:
        problem = f"stimuli: expected 0 or at least {MIN_STIMULI}, found {calibration.stimuli}"
        raise document.error(f"{problem}; fewer leave the threshold unknown", "calibration.stimuli")
    if calibration.times_threshold and not calibration.stimuli:
        problem = "times_threshold needs the threshold, which stimuli = 0 leaves out"
        raise document.error(problem, "calibration.times_threshold")
    count = len(vibrating(patterns[name]))
    if count < 2 and calibration.presentations:
        problem = f"two patterns can be confused, but the procedure of {name} has {count} that vibrate"
        raise document.error(f"{problem}; set presentations = 0", "calibration.presentations")
    return replace(calibration, condition=name)


def vibrating(patterns: Sequence[Pattern]) -> list[Pattern]:
    """Return the patterns that vibrate; those that follow a measure at their strongest."""
    return [
        replace(pattern, amplitude=amplitude_range((pattern,))[1], follow=())
        for pattern in patterns
        if pattern.kind != "off"
    ]


def next_stimulus(
    task: Task,
    calibration: Calibration,
    patterns: Sequence[Pattern],
    responses: Sequence[Response],
    key: tuple[int, int],
) -> Stimulus | None:
    """Return the next stimulus of a task; None if the task is complete.

    Args:
        task: The task.
        calibration: How long it is.
        patterns: The procedure's, with the amplitudes of the trials.
        responses: All so far of the participant on the device, in order.
        key: The study's seed and the participant's slot.
    """
    if task == "threshold":
        return _next_of_threshold(calibration, patterns, responses, key)
    return _next_of_patterns(calibration, vibrating(patterns), responses, key)


def threshold_of(responses: Sequence[Response]) -> Threshold:
    """Estimate the threshold from the responses of its task."""
    return estimate_threshold(_answers(responses))


def _next_of_threshold(
    calibration: Calibration,
    patterns: Sequence[Pattern],
    responses: Sequence[Response],
    key: tuple[int, int],
) -> Stimulus | None:
    number = len(responses) + 1
    if number > calibration.stimuli:
        return None
    amplitude = 0.0 if is_catch(number, *key) else next_amplitude(_answers(responses))
    weakest = min(vibrating(patterns), key=lambda pattern: pattern.amplitude)
    pattern = Pattern("vibration", "bursts", amplitude, weakest.frequency_hz, on_ms=ON_MS, count=1)
    return Stimulus(number, calibration.stimuli, 1, pattern, (FELT, NOT_FELT))


def _next_of_patterns(
    calibration: Calibration,
    patterns: Sequence[Pattern],
    responses: Sequence[Response],
    key: tuple[int, int],
) -> Stimulus | None:
    size = calibration.presentations * len(patterns)
    rounds, place = divmod(len(responses), size)
    is_learned = rounds > 0 and all(
        each.is_correct for each in responses[(rounds - 1) * size : rounds * size]
    )
    if rounds == calibration.max_rounds or (place == 0 and is_learned):
        return None
    order = shuffled([*patterns] * calibration.presentations, *key, "patterns", rounds)
    choices = tuple(pattern.name for pattern in patterns)
    return Stimulus(
        number=len(responses) + 1,
        of=(rounds + 1) * size,
        round=rounds + 1,
        pattern=order[place],
        choices=choices,
        patterns=tuple(patterns),
        is_first=place == 0,
    )


def _answers(responses: Sequence[Response]) -> list[Answered]:
    return [Answered(each.amplitude, each.response == FELT) for each in responses]
