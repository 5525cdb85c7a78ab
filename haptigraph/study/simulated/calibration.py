"""How a simulated participant responds to a stimulus of the calibration: felt or not, and which pattern.

An amplitude is perceived with the participant's Weber fraction as noise, and felt from the absolute threshold
on. A pattern is named by its cue; those with the same cue by their perceived amplitude.
"""

from statistics import NormalDist

from haptigraph.checksum import hashed_integer
from haptigraph.haptics.pattern import NS_PER_MS, amplitude_at
from haptigraph.messages import HapticCommand, Pattern
from haptigraph.study.preparation.calibration import FELT, NOT_FELT, Stimulus
from haptigraph.study.simulated.haptic_perception import HapticPerception
from haptigraph.study.simulated.participant import Participant

__all__ = ["response_to"]

PRESENTATION_MS = 1000
STEP_MS = 20


def response_to(stimulus: Stimulus, participant: Participant, *key: object) -> str:
    """Return the response to a stimulus; it depends on stimulus, participant and key alone.

    Args:
        stimulus: The stimulus.
        participant: Absolute threshold and Weber fraction.
        key: Of the noise.
    """
    chance = (hashed_integer(*key, stimulus.number) + 0.5) / 2**63
    noise = participant.weber_fraction * NormalDist().inv_cdf(chance)
    amplitude = stimulus.pattern.amplitude * (1 + noise)
    is_felt = amplitude >= participant.absolute_threshold
    if not stimulus.patterns:
        return FELT if is_felt else NOT_FELT
    if not is_felt:
        return stimulus.choices[int(chance * len(stimulus.choices))]
    cues = _cues(stimulus.pattern, participant)
    alike = [each for each in stimulus.patterns if _cues(each, participant) == cues]
    return min(alike, key=lambda each: abs(each.amplitude - amplitude)).name


def _cues(pattern: Pattern, participant: Participant) -> frozenset[str]:
    """Return the cues that are perceived while a pattern is played once."""
    perception, command = HapticPerception(participant.absolute_threshold), HapticCommand(0, pattern, 0)
    cues, before = set(), 0.0
    for ms in range(0, PRESENTATION_MS, STEP_MS):
        amplitude = amplitude_at(command, ms * NS_PER_MS)
        if amplitude != before:
            perception.add(ms / 1000, amplitude)
            before = amplitude
        cues.add(perception.at(ms / 1000).cue)
    return frozenset(cues)
