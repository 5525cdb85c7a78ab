"""How strong the patterns of a participant's trials are: from the calibration to haptic settings. Pure.

The guard's limits are the station's; nothing here raises them.
"""

from collections.abc import Sequence

from msgspec import Struct
from msgspec.structs import replace

from haptigraph.config import HapticsConfig
from haptigraph.haptics.pattern import amplitude_range
from haptigraph.messages import Pattern
from haptigraph.study.preparation.calibration import Calibration, Response, threshold_of

__all__ = ["Strength", "haptics_of", "strength_of"]


class Strength(Struct, frozen=True):
    """How strong the weakest pattern of a condition is."""

    weakest_amplitude: float | None
    """None: as in the procedure."""
    because: str


def strength_of(
    calibration: Calibration | None,
    patterns: Sequence[Pattern],
    responses: Sequence[Response],
    base: HapticsConfig,
) -> Strength:
    """Return how strong a condition's patterns are for a participant, and why.

    Args:
        calibration: The protocol's.
        patterns: Of the condition's procedure.
        responses: Of the threshold's task, on the station's device.
        base: Device and limits of the station.
    """
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
    limit = min(amplitude_range(patterns)[1], base.max_amplitude)
    times = f"{calibration.times_threshold:g} times the threshold of {threshold.amplitude:.3f}"
    if amplitude >= limit:
        because = f"as in the procedure: {times} is {amplitude:.2f}, not below the strongest, {limit:.2f}"
        return Strength(None, because)
    return Strength(amplitude, f"the weakest pattern has amplitude {amplitude:.3f}, {times}")


def haptics_of(
    touch: bool | str, sham_duty: float | None, seed: int, weakest: Strength, base: HapticsConfig
) -> HapticsConfig:
    """Return the haptic settings of a trial.

    Args:
        touch: The condition's.
        sham_duty: The condition's; None: the default.
        seed: Of the trial, for a sham.
        weakest: How strong its patterns are.
        base: Device and limits of the station.
    """
    if not touch:
        return replace(base, max_amplitude=0.0)
    settings = replace(base, weakest_amplitude=weakest.weakest_amplitude)
    if touch == "sham":
        settings = replace(settings, sham_seed=seed, sham_duty=sham_duty or base.sham_duty)
    return settings
