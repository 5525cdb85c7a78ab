"""The detection threshold of vibration: from answers "felt" and "not felt" to the next amplitude.

It serves the calibration of a participant's hand, and of a device: there, the length of a burst or the
amplitude of a second vibration takes the place of the amplitude.

Bayesian adaptive method for yes/no answers with catch trials. Each amplitude lies at the posterior mean of
the threshold (ZEST: King-Smith et al. 1994, Vision Res. 34, 885-912). The posterior is over threshold,
spread, false alarms and lapses at once, so that catch trials correct the threshold for guessing. Pure.
"""

import math
from collections.abc import Sequence
from functools import lru_cache

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from haptigraph.checksum import hashed_integer

__all__ = ["CATCH_EVERY", "Answered", "Threshold", "estimate_threshold", "is_catch", "next_amplitude"]

Floats = NDArray[np.float64]
CATCH_EVERY = 5
"""One of so many stimuli is silence."""
MIN_DB, MAX_DB = -46.0, 0.0  # 20 log10 of the amplitude; amplitudes that are presented
THRESHOLDS_DB = np.arange(-50.0, 6.25, 0.5)  # equally probable before the first answer
SPREADS_DB = np.array([0.5, 1.0, 2.0, 4.0, 7.0])  # each combination equally probable, too
FALSE_ALARMS = np.array([0.01, 0.05, 0.1, 0.2, 0.35])
LAPSES = np.array([0.01, 0.05])
COMPARED_DB = 4.0  # largest spread between two vibrations; a Weber fraction of 0.3 makes 1.8 dB
TAIL = 0.025  # of the interval


class Answered(Struct, frozen=True):
    """One stimulus and its answer."""

    amplitude: float
    """0: a catch trial."""
    is_felt: bool


class Threshold(Struct, frozen=True):
    """An estimate of the amplitude that is felt half of the time, or another share of it.

    It is corrected for false alarms and lapses.
    """

    amplitude: float
    """exp of the posterior mean of its logarithm."""
    low: float
    """Start of the interval of 95 % posterior probability."""
    high: float
    sd_db: float
    """Posterior standard deviation [dB]."""
    stimuli: int
    """Number of answers, catch trials included."""
    catch_trials: int
    false_alarms: int
    """Catch trials that were felt."""

    @property
    def is_known(self) -> bool:
        """Whether the interval lies within the amplitudes that can be presented."""
        return self.low >= _amplitude(MIN_DB) and self.high <= _amplitude(MAX_DB)


def is_catch(number: int, *key: object) -> bool:
    """Return whether a stimulus (from 1) is silence: one of every five, at a place drawn by the key."""
    block, place = divmod(number - 1, CATCH_EVERY)
    return place == hashed_integer(*key, "catch", block) % CATCH_EVERY


def next_amplitude(answers: Sequence[Answered], *, compares: bool = False) -> float:
    """Return the next amplitude, in (0, 1], in whole decibels; arguments as of `estimate_threshold`."""
    mean_db, _ = _moments(THRESHOLDS_DB, _probabilities(answers, compares=compares).sum(axis=1))
    return _amplitude(min(max(round(mean_db), MIN_DB), MAX_DB))


def estimate_threshold(
    answers: Sequence[Answered], share: float = 0.5, *, compares: bool = False
) -> Threshold:
    """Estimate the threshold from all answers of a participant on a device.

    Args:
        answers: In any order.
        share: How often the amplitude that is estimated is felt, without guesses and lapses.
        compares: Whether each answer compares two vibrations: then nobody can prefer one of the answers, and
            large spreads are left out.
    """
    probabilities = _probabilities(answers, compares=compares)
    levels_db = np.add.outer(THRESHOLDS_DB, math.log(share / (1 - share)) * SPREADS_DB)
    order = np.argsort(levels_db, axis=None, kind="stable")
    levels_db, probabilities = levels_db.ravel()[order], probabilities.ravel()[order]
    mean_db, sd_db = _moments(levels_db, probabilities)
    sums = np.cumsum(probabilities)
    low_db, high_db = (levels_db[int(np.searchsorted(sums, tail))] for tail in (TAIL, 1 - TAIL))
    catch = [each for each in answers if each.amplitude == 0]
    return Threshold(
        amplitude=_amplitude(mean_db),
        low=_amplitude(float(low_db)),
        high=_amplitude(float(high_db)),
        sd_db=sd_db,
        stimuli=len(answers),
        catch_trials=len(catch),
        false_alarms=sum(each.is_felt for each in catch),
    )


def _probabilities(answers: Sequence[Answered], *, compares: bool) -> Floats:
    """Return the posterior probabilities of thresholds and spreads, (thresholds, spreads)."""
    log_likelihood = np.zeros((len(THRESHOLDS_DB), len(SPREADS_DB), len(FALSE_ALARMS), len(LAPSES)))
    for each in answers:
        log_likelihood += _log_likelihoods(each.amplitude)[0 if each.is_felt else 1]
    if compares:
        log_likelihood[:, COMPARED_DB < SPREADS_DB] = -np.inf
        log_likelihood[:, :, LAPSES.max() < FALSE_ALARMS] = -np.inf
    likelihood: Floats = np.exp(log_likelihood - log_likelihood.max()).sum(axis=(2, 3))
    likelihood /= likelihood.sum()
    return likelihood


@lru_cache(maxsize=256)
def _log_likelihoods(amplitude: float) -> tuple[Floats, Floats]:
    """Return log P(felt) and log P(not felt) of an amplitude, for every combination of parameters."""
    threshold_db, spread_db, false_alarms, lapses = np.ix_(THRESHOLDS_DB, SPREADS_DB, FALSE_ALARMS, LAPSES)
    level_db = 20 * math.log10(amplitude) if amplitude else -math.inf
    with np.errstate(over="ignore"):
        detected = 1 / (1 + np.exp((threshold_db - level_db) / spread_db))
    felt = false_alarms + (1 - false_alarms - lapses) * detected
    return np.log(felt), np.log1p(-felt)


def _moments(levels_db: Floats, probabilities: Floats) -> tuple[float, float]:
    mean_db = float(probabilities @ levels_db)
    return mean_db, math.sqrt(float(probabilities @ (levels_db - mean_db) ** 2))


def _amplitude(level_db: float) -> float:
    return float(10 ** (level_db / 20))
