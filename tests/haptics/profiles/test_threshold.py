"""The estimate of a simulated observer's threshold: its bias, its spread, and whether its interval is true."""

import math

import numpy as np
import pytest

from haptigraph.haptics.profiles.threshold import (
    CATCH_EVERY,
    Answered,
    estimate_threshold,
    is_catch,
    next_amplitude,
)


def measured(threshold, spread_db, false_alarms, lapses, seed, stimuli=40):
    """Return the estimate for an observer with a logistic psychometric function."""
    rng, answers = np.random.default_rng(seed), []
    for number in range(1, stimuli + 1):
        amplitude = 0.0 if is_catch(number, seed) else next_amplitude(answers)
        above = 20 * math.log10(amplitude / threshold) / spread_db if amplitude else -math.inf
        detected = 1 / (1 + math.exp(-above)) if amplitude else 0.0
        chance = false_alarms + (1 - false_alarms - lapses) * detected
        answers.append(Answered(amplitude, bool(rng.random() < chance)))
    return estimate_threshold(answers)


@pytest.mark.parametrize(
    ("spread_db", "false_alarms", "lapses", "most_bias_db", "most_sd_db"),
    [(0.5, 0.0, 0.0, 0.15, 0.5), (2.0, 0.0, 0.0, 0.5, 1.4), (2.0, 0.1, 0.02, 0.7, 1.7)],
)
def test_forty_stimuli_find_a_threshold_without_bias_and_with_a_true_interval(
    spread_db, false_alarms, lapses, most_bias_db, most_sd_db
):
    thresholds = 10 ** (np.random.default_rng(1).uniform(-34, -6, 40) / 20)
    found = [
        measured(threshold, spread_db, false_alarms, lapses, seed)
        for seed, threshold in enumerate(thresholds)
    ]
    errors_db = [20 * math.log10(each.amplitude / true) for each, true in zip(found, thresholds, strict=True)]
    assert abs(np.mean(errors_db)) < most_bias_db
    assert np.std(errors_db) < most_sd_db
    assert np.sqrt(np.mean([each.sd_db**2 for each in found])) >= 0.8 * np.std(errors_db)
    covered = [each.low <= true <= each.high for each, true in zip(found, thresholds, strict=True)]
    assert np.mean(covered) >= 0.92
    assert np.mean([each.is_known for each in found]) >= 0.95


def test_one_of_five_stimuli_is_silent_at_places_that_differ_between_participants():
    places = [[number for number in range(1, 41) if is_catch(number, 7, slot)] for slot in range(4)]
    assert all(len(each) == 8 for each in places)
    assert all(
        sum(5 * block < number <= 5 * block + CATCH_EVERY for number in each) == 1
        for each in places
        for block in range(8)
    )
    assert len({tuple(each) for each in places}) == 4


def test_an_observer_who_feels_nothing_or_says_yes_to_everything_has_no_known_threshold():
    numb = estimate_threshold([Answered(next_amplitude([]), False)] + [Answered(1.0, False)] * 30)
    assert not numb.is_known and numb.high > 1
    eager = [Answered(0.0 if is_catch(number, 1) else 0.01, True) for number in range(1, 41)]
    found = estimate_threshold(eager)
    assert (found.catch_trials, found.false_alarms, found.is_known) == (8, 8, False)


def test_amplitudes_are_presentable_and_the_first_depends_on_nothing():
    assert next_amplitude([]) == pytest.approx(10 ** (-22 / 20))
    assert next_amplitude([Answered(1.0, False)] * 40) == 1.0
    assert next_amplitude([Answered(0.005, True)] * 40) == pytest.approx(10 ** (-46 / 20))
    blank = estimate_threshold([])
    assert not blank.is_known and blank.sd_db > 10 and blank.stimuli == 0
