"""The haptic settings of a stage: from protocol and calibration to the settings of a run. Pure.

The guard's limits are the station's; nothing here raises them.
"""

from collections.abc import Sequence
from functools import lru_cache

from msgspec import Struct
from msgspec.structs import replace

from haptigraph.assemble import parse_procedure
from haptigraph.config import HapticsConfig
from haptigraph.errors import BadInput
from haptigraph.haptics.pattern import amplitude_range, with_weakest
from haptigraph.messages import Pattern
from haptigraph.study.calibration import Response, Stimulus, next_stimulus, threshold_of
from haptigraph.study.plan import Stage
from haptigraph.study.progress import Progress
from haptigraph.study.protocol import Condition, Protocol

__all__ = [
    "Strength",
    "calibration_patterns",
    "haptics_of",
    "responded",
    "stimulus_of",
    "strength_of",
    "touch_of",
]


class Strength(Struct, frozen=True):
    """How strong the weakest pattern of a condition is."""

    weakest_amplitude: float | None
    """None: as in the procedure."""
    because: str


def touch_of(condition: Condition) -> str:
    """Return the haptic output of a condition in a word: on, off or sham."""
    return "sham" if condition.touch == "sham" else "on" if condition.touch else "off"


def haptics_of(protocol: Protocol, stage: Stage, base: HapticsConfig, progress: Progress) -> HapticsConfig:
    """Return the haptic settings of a trial.

    Args:
        protocol: The protocol.
        stage: The trial.
        base: Device and limits of the station.
        progress: Of the participant, for the calibration on this device.
    """
    condition = protocol.condition(stage.condition)
    if not condition.touch:
        return replace(base, max_amplitude=0.0)
    strength = strength_of(protocol, condition, progress.responses.get(("threshold", base.device), ()), base)
    settings = replace(base, weakest_amplitude=strength.weakest_amplitude)
    if condition.touch == "sham":
        settings = replace(settings, sham_seed=stage.seed)
        if condition.sham_duty is not None:
            settings = replace(settings, sham_duty=condition.sham_duty)
    return settings


def strength_of(
    protocol: Protocol, condition: Condition, responses: Sequence[Response], base: HapticsConfig
) -> Strength:
    """Return how strong a condition's patterns are for a participant, and why.

    Args:
        protocol: The protocol.
        condition: A condition with haptic output.
        responses: Of the threshold's task, on the station's device.
        base: Device and limits of the station.
    """
    calibration = protocol.calibration
    if calibration is None or not calibration.times_threshold:
        return Strength(base.weakest_amplitude, "as in the procedure")
    if len(responses) < calibration.stimuli:
        return Strength(None, f"as in the procedure: no threshold was measured on {base.device}")
    threshold = threshold_of(responses)
    if not threshold.is_known:
        return Strength(
            None, "as in the procedure: the threshold is outside the amplitudes that were presented"
        )
    amplitude = round(calibration.times_threshold * threshold.amplitude, 4)
    limit = min(amplitude_range(_patterns(protocol, condition))[1], base.max_amplitude)
    times = f"{calibration.times_threshold:g} times the threshold of {threshold.amplitude:.3f}"
    if amplitude >= limit:
        because = f"as in the procedure: {times} is {amplitude:.2f}, not below the strongest, {limit:.2f}"
        return Strength(None, because)
    return Strength(amplitude, f"the weakest pattern has amplitude {amplitude:.3f}, {times}")


def calibration_patterns(protocol: Protocol, base: HapticsConfig, progress: Progress) -> tuple[Pattern, ...]:
    """Return the patterns of the calibration, as strong as in this participant's trials."""
    condition = protocol.condition(protocol.calibration.condition if protocol.calibration else "")
    responses = progress.responses.get(("threshold", base.device), ())
    weakest = strength_of(protocol, condition, responses, base).weakest_amplitude
    patterns = _patterns(protocol, condition)
    return patterns if weakest is None else with_weakest(patterns, weakest)


def stimulus_of(
    protocol: Protocol, stage: Stage | None, base: HapticsConfig, progress: Progress, slot: int
) -> Stimulus | None:
    """Return the next stimulus of a stage, as the guard lets it through; None if there is none."""
    if stage is None or stage.task is None or protocol.calibration is None:
        return None
    patterns = calibration_patterns(protocol, base, progress)
    responses = progress.responses.get((stage.task, base.device), ())
    key = protocol.study.seed, slot
    stimulus = next_stimulus(stage.task, protocol.calibration, patterns, responses, key)
    if stimulus is None:
        return None
    amplitude = min(stimulus.pattern.amplitude, base.max_amplitude)
    return replace(stimulus, pattern=replace(stimulus.pattern, amplitude=amplitude))


def responded(
    protocol: Protocol,
    stage: Stage,
    base: HapticsConfig,
    progress: Progress,
    slot: int,
    number: int,
    response: str,
) -> tuple[dict[str, object], bool]:
    """Return the row of a response to a stimulus, and whether it completes the task; adds it to the progress.

    Raises:
        BadInput: If another stimulus comes next, or there is no such response.
    """
    stimulus = stimulus_of(protocol, stage, base, progress, slot)
    if stimulus is None or stage.task is None or stimulus.number != number:
        found = f"stimulus {stimulus.number}" if stimulus else "none"
        raise BadInput(f"{stage.key}: stimulus {number} does not come next, but {found}")
    if response not in stimulus.choices:
        raise BadInput(f"{stage.key}: expected {', '.join(stimulus.choices)}; found {response[:40]!r}")
    name = stimulus.pattern.name if stage.task == "patterns" else ""
    given = Response(name, stimulus.pattern.amplitude, response)
    progress.responses.setdefault((stage.task, base.device), []).append(given)
    row = {
        "task": stage.task,
        "device": base.device,
        "number": number,
        "round": stimulus.round,
        "pattern": given.pattern or None,
        "amplitude": given.amplitude,
        "response": response,
        "correct": int(given.is_correct),
    }
    return row, stimulus_of(protocol, stage, base, progress, slot) is None


def _patterns(protocol: Protocol, condition: Condition) -> tuple[Pattern, ...]:
    return _parsed_patterns(protocol.procedures[condition.procedure], condition.procedure)


@lru_cache(maxsize=16)
def _parsed_patterns(text: str, name: str) -> tuple[Pattern, ...]:
    return parse_procedure(text, name).patterns
