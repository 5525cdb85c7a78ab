"""What a simulated participant does at one stage of a study: a trial to be steered, an answer.

Turns a stage of the plan and a seed into a trial that needs no file, so that it can be played on any machine,
and an item into an answer. Knows no store.
"""

import math
from datetime import UTC, datetime, timedelta

from msgspec import Struct
from msgspec.structs import replace

from haptigraph.config import Config
from haptigraph.messages import Capture, Step
from haptigraph.recording.writer import RunWriter
from haptigraph.run_header import run_info_at
from haptigraph.sim.eye.eye import EyeShape
from haptigraph.sinks.recorder import Recorder
from haptigraph.study.conditions import drawn
from haptigraph.study.plan import Stage
from haptigraph.study.protocol import Protocol
from haptigraph.study.questionnaire import Item
from haptigraph.study.simulated.participant import Participant
from haptigraph.study.simulated.rehearsal import KNOWN, Condition, Rehearsal, coming_in
from haptigraph.version import __version__

__all__ = ["Act", "act_of", "answer_of", "recorder_of", "rehearse"]

MOST = 100  # where a number may be of any size
EPOCH = datetime(1970, 1, 1, tzinfo=UTC)


class Act(Struct, frozen=True):
    """One trial, with all it depends on besides who steers it."""

    stage: Stage
    condition: Condition
    target_deg: float
    """Along the retina, at the eye's centre."""


def act_of(protocol: Protocol, stage: Stage) -> Act:
    """Return a stage of a protocol as a trial that needs no file."""
    under = protocol.condition(stage.condition)
    text = protocol.procedures[under.procedure]
    condition = Condition(under.name, under.procedure, 1.0 if under.touch else 0.0, text)
    radius_mm = EyeShape().diameter_mm / 2
    return Act(stage, condition, math.degrees(protocol.target(stage.target).along_mm / radius_mm))


def rehearse(
    act: Act, who: Participant, seed: int, perceiver: str = KNOWN, config: Config | None = None
) -> Rehearsal:
    """Prepare a trial: the same eye for everyone, its target as the protocol has it.

    Raises:
        BadInput: If a simulated participant does not know what to do under its procedure.
    """
    seeds = seed, 9, act.stage.seed
    scenario = coming_in(EyeShape(target_deg=act.target_deg), drawn(*seeds) % 2**31)
    limit_s = act.stage.timeout_s
    return Rehearsal(who, act.condition, scenario, seeds, perceiver=perceiver, config=config, limit_s=limit_s)


def answer_of(item: Item, seed: int, participant: str, stage: Stage) -> str:
    """Return an answer that is drawn evenly from all that the item takes.

    It depends on seed, participant, item and when it is asked: not on the condition, nor on what was felt. So
    conditions differ by chance alone, and a test of them is a test of the test.
    """
    chance = drawn(seed, "answer", participant, stage.key, item.key)
    if item.kind == "choice":
        return item.choices[chance % len(item.choices)]
    if item.kind == "text":
        return "simulated"
    least = min(0.0, item.high or 0.0) if item.low is None else item.low
    low, high = math.ceil(least), math.floor(least + MOST if item.high is None else item.high)
    return str(low + chance % (high - low + 1)) if low <= high else str(least)


def recorder_of(rehearsal: Rehearsal, path: str, began: datetime) -> Recorder:
    """Return the recorder of a trial; equal trials make equal files.

    Args:
        rehearsal: The trial.
        path: The new file.
        began: When, by the time of the session.
    """
    config = replace(rehearsal.config, recording=replace(rehearsal.config.recording, path=""))
    procedure, registration = rehearsal.procedure, rehearsal.registration
    info = run_info_at(
        began,
        (began - EPOCH) // timedelta(microseconds=1) * 1000,
        config,
        rehearsal.loop.source.rate_hz,
        registration,
        procedure,
        __version__,
    )
    writer = RunWriter(path, info, registration.image, procedure.schema.measure_names)
    return _Recorder(writer, drawn=config.perception.perceiver != KNOWN)


class _Recorder(Recorder):
    """Leave out what another machine would not have: how long stages took. And images that were not drawn."""

    def __init__(self, writer: RunWriter, *, drawn: bool) -> None:
        super().__init__(writer, waits=True)
        self._drawn = drawn

    def write(self, capture: Capture, step: Step) -> None:
        timing = step.timing and replace(step.timing, stage_ns={})
        capture = capture if self._drawn else replace(capture, image=None)
        super().write(capture, replace(step, timing=timing))
