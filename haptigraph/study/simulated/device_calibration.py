"""A simulated person who measures simulated devices: answers to the trials of `devices calibrate`.

A vibration is perceived with the participant's Weber fraction as noise, and felt from the absolute threshold
on. Its magnitude grows with a power of its strength (Stevens 1957, Psychol. Rev. 64).
"""

import math
import random
from collections.abc import Callable, Mapping

from msgspec import Struct

from haptigraph.haptics.profiles.measuring import NUMBER, Burst, Trial
from haptigraph.study.simulated.participant import Participant

__all__ = ["SimulatedActuator", "SimulatedHand"]

RATING_SD = 0.15
"""Relative standard deviation of a rating of the same magnitude; assumed."""


class SimulatedActuator(Struct, frozen=True):
    """How strong a device vibrates."""

    response: Callable[[float], float]
    """From drive to strength, in the unit of the participant's absolute threshold."""
    rise_ms: float = 1.0
    """Time constant of its rise."""

    def strength_of(self, burst: Burst) -> float:
        """Return the largest strength of a burst."""
        return self.response(burst.drive) * (1 - math.exp(-burst.on_ms / self.rise_ms))


class SimulatedHand:
    """A person who holds one or two devices; `hand(trial)` answers.

    Args:
        participant: Absolute threshold and Weber fraction.
        actuators: The "device", and the "reference" if there is one.
        seed: Of the noise.
        exponent: Of magnitude over strength.
        lapse_share: How often an answer has nothing to do with the trial.
    """

    def __init__(
        self,
        participant: Participant,
        actuators: Mapping[str, SimulatedActuator],
        seed: int,
        exponent: float = 0.8,
        lapse_share: float = 0.02,
    ) -> None:
        self._participant, self._actuators = participant, actuators
        self._exponent, self._lapse_share = exponent, lapse_share
        self._random = random.Random(seed)

    def __call__(self, trial: Trial) -> str:
        """Return the answer to a trial."""
        if trial.choices != NUMBER and self._random.random() < self._lapse_share:
            return self._random.choice(trial.choices)
        perceived = [self._perceived(burst) for burst in trial.bursts]
        if trial.task in ("threshold", "onset"):
            return "y" if perceived[0] >= self._participant.absolute_threshold else "n"
        if trial.task == "match":
            return "1" if perceived[0] > perceived[1] else "2"
        if perceived[1] < self._participant.absolute_threshold:
            return "0"
        strengths = [self._actuators[burst.output].strength_of(burst) for burst in trial.bursts]
        magnitude = self.magnitude_of(strengths[1]) / self.magnitude_of(strengths[0])
        return str(max(round(100 * magnitude * math.exp(self._random.gauss(0, RATING_SD))), 1))

    def magnitude_of(self, strength: float) -> float:
        """Return the perceived magnitude of a strength, without noise."""
        return float(strength**self._exponent)

    def _perceived(self, burst: Burst) -> float:
        strength = self._actuators[burst.output].strength_of(burst)
        return strength * (1 + self._participant.weber_fraction * self._random.gauss(0, 1))
