import numpy as np
import pytest
from msgspec.structs import replace
from robot_runs import led_path, simulated_run

from haptigraph.analysis.robot.lag import Motion, estimate_lag
from haptigraph.errors import BadInput


def motion(seed, **given):
    run = simulated_run(np.random.default_rng(seed), **given)
    return Motion(run.image_s, run.image_mm, run.robot_s, run.robot_mm)


@pytest.mark.parametrize("lag_s", [0.0, -2.4, 0.0123, 2.4])
def test_a_known_lag_lies_in_the_interval(lag_s):
    found = estimate_lag(motion(11, seconds=20, lag_s=lag_s), "run.mcap")
    low, high = found.interval_s
    half_s = high - found.lag_s
    assert abs(found.lag_s - lag_s) < 2 * half_s < 0.02
    assert found.explained_share > 0.99
    assert (low > 0 or high < 0) == (lag_s != 0.0)


def test_a_drifting_clock_is_found():
    found = estimate_lag(motion(12, seconds=30, lag_s=0.1, drift=2e-3), "run.mcap")
    low, high = found.drift_interval_s_per_s
    assert low < 2e-3 < high and found.is_drift_significant


def test_outliers_of_the_tracker_do_not_move_it():
    given = motion(13, seconds=20, lag_s=0.5)
    image_mm = given.image_mm.copy()
    image_mm[::17] += 5.0
    found = estimate_lag(replace(given, image_mm=image_mm), "run.mcap")
    assert abs(found.lag_s - 0.5) < 0.01


def periodic(period_s):
    image_s, robot_s = np.arange(0, 20, 1 / 30), np.arange(-6, 26, 0.004)
    there, robot = (
        np.column_stack((5 * np.cos(2 * np.pi * t / period_s), 5 * np.sin(2 * np.pi * t / period_s)))
        for t in (image_s, robot_s)
    )
    noise = np.random.default_rng(1).normal(0, 0.02, there.shape)
    return Motion(image_s, there + noise, robot_s, np.column_stack((robot, np.zeros(len(robot)))))


def still():
    given = motion(14, seconds=10)
    return replace(given, image_mm=0.02 * given.image_mm)


def unrelated():
    return replace(motion(15, seconds=20), image_mm=motion(16, seconds=20).image_mm)


@pytest.mark.parametrize(
    "given, problem",
    [
        (periodic(2.0), "ambiguous"),
        (still(), "too little motion"),
        (unrelated(), "explains only"),
        (replace(motion(17, seconds=10), image_s=np.arange(300) / 30 + 100.0), "do not overlap"),
        (motion(18, seconds=1), "too few"),
    ],
)
def test_what_cannot_be_known_is_refused(given, problem):
    with pytest.raises(BadInput, match=problem) as refusal:
        estimate_lag(given, "run.mcap")
    assert refusal.value.file == "run.mcap"


@pytest.mark.slow
def test_intervals_of_200_runs_cover_the_truth():
    inside = []
    for seed in range(5000, 5200):
        lag_s = float(np.random.default_rng(seed).uniform(-2.4, 2.4))
        found = estimate_lag(motion(seed, lag_s=lag_s, jitter_s=0.005 * (seed % 2)), "run.mcap")
        inside.append(found.interval_s[0] <= lag_s <= found.interval_s[1])
    assert 0.90 <= np.mean(inside) <= 0.99


@pytest.mark.slow
def test_intervals_of_the_hands_lag_in_200_runs_cover_the_truth():
    inside = []
    for seed in range(5200, 5400):
        lag_s = float(np.random.default_rng(seed).uniform(-0.3, 0.0))
        run = simulated_run(np.random.default_rng(seed), lag_s=lag_s, robot_sd_mm=0.0)
        found = estimate_lag(Motion(run.image_s, run.image_mm, *led_path(run)), "run.mcap", mover="hand")
        inside.append(found.interval_s[0] <= lag_s <= found.interval_s[1])
    assert 0.90 <= np.mean(inside) <= 0.99
