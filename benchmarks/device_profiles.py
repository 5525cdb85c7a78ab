"""Simulated persons calibrate simulated devices: do the stated intervals hold, and is "low" the same on each?

Three actuators differ in response, onset and strength; the reference is a coil whose strength is its drive.
Every person is drawn with a seed (`--seed`), and calibrates every actuator by comparison with the reference,
and by rating. The responses of the actuators are invented; nobody held a real one.
"""

import argparse
import datetime
import math
from collections.abc import Callable
from statistics import NormalDist
from typing import NamedTuple

import numpy as np

from haptigraph.haptics.profiles.calibration import Calibrated, calibrate
from haptigraph.haptics.profiles.measuring import Unusable
from haptigraph.haptics.profiles.profile import DeviceProfile
from haptigraph.study.simulated.device_calibration import SimulatedActuator, SimulatedHand
from haptigraph.study.simulated.participant import Participant, draw_participant

Z_975 = 1.96
REFERENCE = SimulatedActuator(lambda drive: drive)
ACTUATORS = {
    "motor": SimulatedActuator(lambda drive: 0.9 * (max(drive - 0.15, 0.0) / 0.85) ** 1.3, rise_ms=30.0),
    "resonant": SimulatedActuator(
        lambda drive: 1.4 * (1 - math.exp(-2.5 * drive)) / (1 - math.exp(-2.5)), 8.0
    ),
    "weak": SimulatedActuator(lambda drive: 0.45 * drive**1.6, rise_ms=15.0),
}
LEVELS = (0.15, 0.3, 0.4, 0.7)


class Given(NamedTuple):
    """An intensity that was asked for on an actuator."""

    wanted: float
    given: float
    sd: float
    """As the profile states it."""

    @property
    def is_covered(self) -> bool:
        """Whether the stated interval of 95 % contains the intensity that was wanted."""
        return abs(self.given - self.wanted) < Z_975 * self.sd


def main() -> None:
    """Print coverage, and what is felt of each level with a profile and without."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--persons", type=int, default=100)
    parser.add_argument("--seed", type=int, default=2026)
    options = parser.parse_args()
    for method in ("audio", ""):
        print(f"\n{'compared with the reference' if method else 'rated, scale of its own'}")
        for name, actuator in ACTUATORS.items():
            _measure(name, actuator, method, options.persons, options.seed)


def _measure(name: str, actuator: SimulatedActuator, reference: str, persons: int, seed: int) -> None:
    """Let persons calibrate an actuator, and print the figures."""
    thresholds, onsets, points, refused = [], [], [], 0
    levels, without = {each: [] for each in LEVELS}, {}
    for number in range(persons):
        person = draw_participant(seed, number)
        hand = SimulatedHand(person, {"device": actuator, "reference": REFERENCE}, hash_of(seed, number))
        felt = _scale(hand, actuator, reference)
        try:
            profile = _calibrated(hand, reference, hash_of(seed, number))
        except Unusable:
            refused += 1
            continue
        thresholds.append(_covers_threshold(profile, actuator, person))
        onsets += _covers_onset(profile, actuator, person)
        points += [
            Given(each.intensity, felt(each.drive), each.sd) for each in profile.intensity.point if each.sd
        ]
        for level in LEVELS:
            without[level] = felt(level)
            if level <= profile.strongest:
                levels[level].append(Given(level, felt(profile.drive_at(level)), profile.sd_at(level)))
    covered = np.mean([each.is_covered for each in points])
    print(
        f"  {name}: intervals contain {np.mean(thresholds):.0%} of the thresholds, {np.mean(onsets):.0%} of "
        f"{len(onsets)} shortest bursts, {covered:.0%} of {len(points)} intensities; "
        f"{refused} of {persons} persons without a result"
    )
    for level, given in levels.items():
        if not given:
            print(f"    amplitude {level:.2f}: stronger than it gets; without profile {without[level]:.2f}")
            continue
        values = np.array([each.given for each in given])
        sd, hits = np.mean([each.sd for each in given]), np.mean([each.is_covered for each in given])
        print(
            f"    amplitude {level:.2f}: felt {values.mean():.3f} (SD {values.std():.3f}, stated {sd:.3f}), "
            f"interval covers {hits:.0%} of {len(given)}; without profile {without[level]:.3f}"
        )


def _calibrated(hand: SimulatedHand, reference: str, seed: int) -> DeviceProfile:
    today = datetime.date(2026, 11, 26)
    given = Calibrated("gamepad:0", "simulated", "simulated", today, seed, None, reference)
    return calibrate(hand, given)


def _scale(hand: SimulatedHand, actuator: SimulatedActuator, reference: str) -> Callable[[float], float]:
    """Return the true intensity of a drive, on the scale of the calibration."""
    if reference:
        return actuator.response
    strongest = hand.magnitude_of(actuator.response(1.0))
    return lambda drive: hand.magnitude_of(actuator.response(drive)) / strongest


def _covers_threshold(profile: DeviceProfile, actuator: SimulatedActuator, person: Participant) -> bool:
    """Return whether the true threshold, which half of all vibrations exceed, is within the interval."""
    low, high = (actuator.response(each) for each in (profile.threshold.low, profile.threshold.high))
    return low <= person.absolute_threshold <= high


def _covers_onset(profile: DeviceProfile, actuator: SimulatedActuator, person: Participant) -> list[bool]:
    """Return whether the interval contains the burst that is felt three times of four; empty: not stated."""
    if profile.onset is None:
        return []
    strength = person.absolute_threshold / (1 - person.weber_fraction * NormalDist().inv_cdf(0.75))
    share = strength / actuator.response(profile.intensity.point[0].drive)
    true_ms = -actuator.rise_ms * math.log(1 - share) if share < 1 else math.inf
    return [profile.onset.low_ms <= true_ms <= profile.onset.high_ms]


def hash_of(seed: int, number: int) -> int:
    """Return a seed of one person."""
    return seed * 10_000 + number


if __name__ == "__main__":
    main()
