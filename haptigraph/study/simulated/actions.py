"""What a simulated participant does at one stage of a study: perform a trial, answer an item.

Turns a stage of the plan into a trial that needs no file, so that any machine can simulate it.
"""

import math
from datetime import UTC, datetime, timedelta

from msgspec import Struct
from msgspec.structs import replace

from haptigraph.checksum import hashed_integer
from haptigraph.config import Config, HapticsConfig
from haptigraph.messages import Capture, Step
from haptigraph.recording.writer import RunWriter
from haptigraph.run_header import run_info_at
from haptigraph.sim.eye.eye import EyeShape
from haptigraph.sinks.recorder import Recorder
from haptigraph.study.plan import Stage
from haptigraph.study.preparation.strength import Strength, haptics_of
from haptigraph.study.protocol import Protocol
from haptigraph.study.questionnaire import Item
from haptigraph.study.simulated.ground_truth import GROUND_TRUTH
from haptigraph.study.simulated.participant import Participant
from haptigraph.study.simulated.rehearsal import Condition, Rehearsal, entry_scenario
from haptigraph.version import __version__

__all__ = ["TrialSpec", "answer_to", "recorder_of", "rehearse", "trial_spec"]

UNMEASURED = Strength(None, "")
OPEN_RANGE = 100  # of numeric items without a bound
EPOCH = datetime(1970, 1, 1, tzinfo=UTC)


class TrialSpec(Struct, frozen=True):
    """One trial, with all that it depends on except the participant."""

    stage: Stage
    condition: Condition
    target_deg: float
    """Along the retina, as an angle about the eye's centre."""
    haptics: HapticsConfig = HapticsConfig()
    """Without a calibration, which only a session has."""


def trial_spec(protocol: Protocol, stage: Stage) -> TrialSpec:
    """Return a stage of a protocol as a trial that needs no file."""
    condition = protocol.condition(stage.condition)
    text = protocol.procedures[condition.procedure]
    haptics = Condition(condition.name, condition.procedure, 1.0 if condition.touch else 0.0, text)
    radius_mm = EyeShape().diameter_mm / 2
    target_deg = math.degrees(protocol.target(stage.target).along_mm / radius_mm)
    settings = haptics_of(condition.touch, condition.sham_duty, stage.seed, UNMEASURED, HapticsConfig())
    return TrialSpec(stage, haptics, target_deg, settings)


def rehearse(
    spec: TrialSpec,
    participant: Participant,
    seed: int,
    perceiver: str = GROUND_TRUTH,
    config: Config | None = None,
) -> Rehearsal:
    """Prepare a trial in the same eye for everyone, with the target of the protocol.

    Raises:
        BadInput: If a simulated participant cannot perform the task of its procedure.
    """
    seeds = seed, 9, spec.stage.seed
    scenario = entry_scenario(EyeShape(target_deg=spec.target_deg), hashed_integer(*seeds) % 2**31)
    limit_s = spec.stage.timeout_s
    config = config or Config(haptics=spec.haptics)
    return Rehearsal(
        participant, spec.condition, scenario, seeds, perceiver=perceiver, config=config, limit_s=limit_s
    )


def answer_to(item: Item, seed: int, participant: str, stage: Stage) -> str:
    """Return an answer that is drawn uniformly from the valid ones.

    It depends on seed, participant, item and stage, but neither on the condition nor on the haptic output. So
    conditions differ by chance alone, and a test of them checks the test.
    """
    chance = hashed_integer(seed, "answer", participant, stage.key, item.key)
    if item.kind == "choice":
        return item.choices[chance % len(item.choices)]
    if item.kind == "text":
        return "simulated"
    minimum = min(0.0, item.high or 0.0) if item.low is None else item.low
    low, high = math.ceil(minimum), math.floor(minimum + OPEN_RANGE if item.high is None else item.high)
    return str(low + chance % (high - low + 1)) if low <= high else str(minimum)


def recorder_of(rehearsal: Rehearsal, path: str, started: datetime) -> Recorder:
    """Return the recorder of a trial; equal trials give equal files.

    Args:
        rehearsal: The trial.
        path: The new file.
        started: When it started, in the time of the session.
    """
    config = replace(rehearsal.config, recording=replace(rehearsal.config.recording, path=""))
    procedure, registration = rehearsal.procedure, rehearsal.registration
    info = run_info_at(
        started,
        (started - EPOCH) // timedelta(microseconds=1) * 1000,
        config,
        rehearsal.loop.source.rate_hz,
        registration,
        procedure,
        __version__,
    )
    writer = RunWriter(path, info, registration.image, procedure.schema.measure_names)
    return _Recorder(writer, has_images=config.perception.perceiver != GROUND_TRUTH)


class _Recorder(Recorder):
    """Omit what differs between machines, the durations of the stages, and images that were not rendered."""

    def __init__(self, writer: RunWriter, *, has_images: bool) -> None:
        super().__init__(writer, waits=True)
        self._has_images = has_images

    def write(self, capture: Capture, step: Step) -> None:
        timing = step.timing and replace(step.timing, stage_ns={})
        capture = capture if self._has_images else replace(capture, image=None)
        super().write(capture, replace(step, timing=timing))
