"""Simulated persons measure simulated actuators: are the stated intervals true, is "low" the same on both?"""

import datetime
import math

import numpy as np
import pytest

from haptigraph.haptics.profiles.calibration import Calibrated, calibrate
from haptigraph.haptics.profiles.latency import measure_latency
from haptigraph.haptics.profiles.measuring import (
    NUMBER,
    Unusable,
    find_onset,
    find_threshold,
    increasing,
    match_intensities,
    rate_intensities,
)
from haptigraph.haptics.profiles.profile import Point, parse_profile
from haptigraph.haptics.profiles.threshold import Threshold
from haptigraph.haptics.profiles.writing import profile_text
from haptigraph.messages import Capabilities
from haptigraph.study.simulated.device_calibration import SimulatedActuator, SimulatedHand
from haptigraph.study.simulated.participant import draw_participant

COIL = SimulatedActuator(lambda drive: drive)
MOTOR = SimulatedActuator(lambda drive: 0.9 * (max(drive - 0.15, 0.0) / 0.85) ** 1.3, rise_ms=30.0)
STRONG = SimulatedActuator(lambda drive: 1.4 * (1 - math.exp(-2.5 * drive)) / (1 - math.exp(-2.5)), 8.0)
PERSON = draw_participant(1, 0)
KNOWN = Threshold(0.2, 0.19, 0.21, 0.5, 40, 8, 0)


def hand_of(device, seed, **traits):
    return SimulatedHand(PERSON, {"device": device, "reference": COIL}, seed, **traits)


def given(reference="", **settings):
    return Calibrated(
        "gamepad:0", "simulated", "S1", datetime.date(2026, 11, 26), 1, None, reference, **settings
    )


@pytest.mark.parametrize(("device", "high"), [(MOTOR, 0.27), (STRONG, 0.03)], ids=["weak", "strong"])
def test_intervals_of_matched_intensities_contain_the_truth(device, high):
    threshold = Threshold(high - 0.01, high - 0.02, high, 0.5, 40, 8, 0)
    points = [
        (each.intensity - device.response(each.drive)) / each.sd
        for seed in range(12)
        for each in match_intensities(hand_of(device, seed), threshold, seed)
    ]
    assert len(points) >= 58
    assert np.mean(np.abs(points) < 1.96) >= 0.9
    assert abs(np.mean(points)) < 0.5 and np.std(points) > 0.5


def test_intervals_of_ratings_contain_the_truth():
    points = []
    for seed in range(25):
        hand = hand_of(MOTOR, seed)
        *rated, strongest = rate_intensities(hand, KNOWN, seed)
        assert strongest == Point(1.0, 1.0, 0.0)
        full = hand.magnitude_of(MOTOR.response(1.0))
        points += [
            (each.intensity - hand.magnitude_of(MOTOR.response(each.drive)) / full) / each.sd
            for each in rated
        ]
    assert np.mean(np.abs(points) < 1.96) >= 0.88
    assert abs(np.mean(points)) < 0.35


def test_a_device_that_is_stronger_than_the_reference_is_driven_no_further_than_it():
    points = match_intensities(hand_of(STRONG, 3), KNOWN, 3)
    assert points[-1].intensity == 1 and points[-1].drive < 0.75
    assert STRONG.response(points[-1].drive) == pytest.approx(1.0, rel=0.3)


def test_two_devices_give_the_same_low_only_with_profiles():
    low, given_low = 0.3, []
    for seed in range(6):
        for device in (MOTOR, STRONG):
            profile = calibrate(hand_of(device, seed), given("audio"))
            felt = device.response(profile.drive_at(low))
            given_low.append((felt - low) / max(profile.sd_at(low), 0.02))
            assert felt == pytest.approx(low, rel=0.5)
    assert np.mean(np.abs(given_low) < 1.96) >= 0.9
    assert STRONG.response(low) > 3 * MOTOR.response(low)


def test_a_whole_calibration_becomes_a_file_that_reads_the_same_to_its_precision():
    instructions = []
    profile = calibrate(hand_of(MOTOR, 4), given("audio", max_drive=0.8), instructions.append)
    assert [each[:4] for each in instructions] == ["Part"] * 3 and "audio" in instructions[1]
    read = parse_profile(profile_text(profile), "p.toml")
    assert read.strongest == pytest.approx(profile.strongest, rel=1e-3)
    assert read.intensity.point[-1].drive == 0.8
    assert (read.intensity.scale, read.device.uri, read.provenance.by) == ("audio", "gamepad:0", "S1")
    assert read.onset is not None and 5 < read.onset.shortest_on_ms < 60


def test_slow_actuators_need_longer_bursts():
    slow, fast = (find_onset(hand_of(each, 2), 0.35, 2) for each in (MOTOR, COIL))
    assert slow.amplitude > 2 * fast.amplitude
    bursts = []

    def ask(trial):
        bursts.extend(trial.bursts)
        return "y" if trial.bursts[0].drive else "n"

    find_onset(ask, 0.5, 1, interval_ms=50.0)
    assert min(burst.on_ms for burst in bursts) == 50
    assert {burst.drive for burst in bursts} == {0.0, 0.5}


def test_an_onset_beyond_the_longest_burst_is_not_stated():
    assert find_onset(lambda trial: "n", 0.5, 1) is None


@pytest.mark.parametrize("answer", ["y", "n"])
def test_a_person_who_always_answers_the_same_has_no_threshold(answer):
    with pytest.raises(Unusable, match="the threshold is outside"):
        find_threshold(lambda trial: answer, "device", 1)


def test_guesses_do_not_become_a_profile_of_increasing_intensities():
    with pytest.raises(Unusable, match="do not order the drives"):
        increasing([Point(0.2, 0.5, 0.1), Point(0.4, 0.4, 0.1)])
    with pytest.raises(Unusable):
        rate_intensities(lambda trial: "100" if trial.choices == NUMBER else "y", KNOWN, 1)


def test_neighbours_out_of_order_are_pooled_and_their_difference_is_uncertainty():
    first, pooled, last = increasing(
        [Point(0.2, 0.1, 0.02), Point(0.4, 0.5, 0.05), Point(0.5, 0.4, 0.04), Point(1.0, 1.0, 0.0)]
    )
    assert (first.intensity, last.drive) == (0.1, 1.0)
    assert 0.4 < pooled.drive < 0.5 and 0.4 < pooled.intensity < 0.5
    assert pooled.sd == pytest.approx(0.05)


def test_drives_that_are_often_not_felt_are_left_out():
    def ask(trial):
        drive = trial.bursts[1].drive
        return "0" if drive < 0.4 else str(round(100 * drive))

    points = rate_intensities(ask, KNOWN, 1)
    assert all(each.drive >= 0.4 for each in points) and len(points) == 4


def test_latency_is_measured_in_silence_with_intervals_from_order_statistics():
    class Board:
        capabilities = Capabilities(255, None, 50.0, answers=True)

        def __init__(self):
            self.commands = []

        def set(self, amplitude, frequency_hz, stamp_ns):
            self.commands.append(amplitude)

        def close(self):
            pass

    ticks = iter(np.repeat(np.random.default_rng(1).permutation(200), 2) * 10_000)
    stamps = iter(range(400))

    def now_ns():
        number = next(stamps)
        tick = int(next(ticks))
        return number * 10**9 + (tick if number % 2 else 0) - (number % 2) * 10**9

    board = Board()
    latency = measure_latency(board, now_ns)
    assert set(board.commands) == {0.0} and latency.commands == 200
    assert latency.p50_ms == pytest.approx(1.0, abs=0.02) and latency.p95_ms == pytest.approx(1.9, abs=0.02)
    assert (
        latency.p50_low_ms < latency.p50_ms < latency.p50_high_ms < latency.p95_low_ms < latency.p95_high_ms
    )
