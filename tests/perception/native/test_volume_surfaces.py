"""Rewards of surfaces against plain means, and best paths through all slices at once."""

import itertools

import numpy as np
import pytest

from haptigraph.perception.native.bscan import best_path
from haptigraph.perception.native.volume_surfaces import best_paths, ilm_rewards, row_sums, rpe_rewards

COST = (2.0 * np.arange(-2, 3) ** 2).astype(np.float32)


def total(reward, rows):
    steps = np.diff(rows)
    return sum(reward[column, row] for column, row in enumerate(rows)) - 2.0 * (steps**2).sum()


@pytest.mark.parametrize("seed", range(4))
def test_every_path_is_the_best_of_all(seed):
    reward = np.random.default_rng(seed).normal(0, 4, (6, 3, 5)).astype(np.float32)
    rows = best_paths(reward, COST)
    for slice_, path in enumerate(rows):
        possible = [
            rows for rows in itertools.product(range(6), repeat=5) if np.abs(np.diff(rows)).max() <= 2
        ]
        best = max(total(reward[:, slice_].T, rows) for rows in possible)
        assert total(reward[:, slice_].T, path) == pytest.approx(best, abs=1e-4)


def test_slices_do_not_interact_and_agree_with_the_path_of_one_b_scan():
    reward = np.random.default_rng(9).normal(0, 4, (30, 4, 20)).astype(np.float32)
    rows = best_paths(reward, COST)
    for slice_ in range(4):
        alone = best_path(np.ascontiguousarray(reward[:, slice_].T), COST)
        assert total(reward[:, slice_].T, rows[slice_]) == pytest.approx(
            total(reward[:, slice_].T, alone), abs=1e-3
        )


def mean(grey, start, end):
    """The mean of rows start to end, counted from each edge; rows beyond the ends repeat them."""
    rows = np.clip(np.arange(len(grey))[:, None] + np.arange(start, end), 0, len(grey) - 1)
    return grey[rows].mean(axis=1)


def across(values):
    padded = np.concatenate([values[:, :1], values, values[:, -1:]], axis=1)
    return 0.5 * values + 0.25 * (padded[:, :-2] + padded[:, 2:])


def saturating(grey):
    return grey / (1 + np.abs(grey) / 45)


def test_rewards_of_the_ilm_are_those_of_plain_means():
    grey = np.random.default_rng(2).uniform(0, 255, (40, 5, 7)).astype(np.float32)
    reward, step, rise = ilm_rewards(grey, 30.0, 3, 9)
    steps = mean(grey, 0, 3) - mean(grey, -3, 0)
    body = np.minimum(mean(grey, 0, 4), mean(grey, 4, 9)) - 30
    rises = body - np.maximum(mean(grey, -9, 0) - 30, 0)
    assert step == pytest.approx(across(steps), abs=1e-2)
    assert rise == pytest.approx(rises, abs=1e-2)
    assert reward == pytest.approx(across(saturating(steps) + saturating(rises) + 0.25 * body), abs=1e-2)


def test_rewards_of_the_rpe_are_those_of_plain_means():
    grey = np.random.default_rng(3).uniform(0, 255, (50, 4, 6)).astype(np.float32)
    reward, smooth_rise, rise, fall = rpe_rewards(grey, 2, 6)
    inner = slice(6, -24)
    body = mean(grey, 0, 6)
    steps = (mean(grey, 0, 2) - mean(grey, -2, 0))[inner]
    rises, falls = (body - mean(grey, -6, 0))[inner], (body - mean(grey, 12, 24))[inner]
    assert rise == pytest.approx(rises, abs=1e-2)
    assert fall == pytest.approx(falls, abs=1e-2)
    assert smooth_rise == pytest.approx(across(rises), abs=1e-2)
    expected = across(saturating(steps) + saturating(rises) + 0.5 * saturating(falls))
    assert reward == pytest.approx(expected, abs=1e-2)


def test_sums_of_rows_repeat_the_ends():
    grey = np.arange(24, dtype=np.float32).reshape(4, 2, 3)
    sums = row_sums(grey, 2, 1)
    repeated = np.concatenate([grey[:1], grey[:1], grey, grey[-1:]])
    assert sums == pytest.approx(np.concatenate([np.zeros((1, 2, 3)), repeated.cumsum(axis=0)]))


VOLUME = np.zeros((40, 3, 4), np.float32)


@pytest.mark.parametrize(
    "call",
    [
        lambda: ilm_rewards(VOLUME.astype(np.float64), 0.0, 2, 8),
        lambda: ilm_rewards(VOLUME[:, ::2], 0.0, 2, 8),
        lambda: ilm_rewards(VOLUME, 0.0, 9, 8),
        lambda: ilm_rewards(VOLUME, 0.0, 1, 1),
        lambda: rpe_rewards(VOLUME, 2, 8),
        lambda: rpe_rewards(VOLUME, 7, 6),
        lambda: row_sums(VOLUME, -1, 0),
        lambda: row_sums(VOLUME[0], 0, 0),
        lambda: best_paths(VOLUME, np.zeros(4, np.float32)),
        lambda: best_paths(VOLUME, np.zeros(5)),
        lambda: best_paths(VOLUME[:0], np.zeros(5, np.float32)),
    ],
)
def test_wrong_arrays_never_reach_c(call):
    with pytest.raises((ValueError, TypeError)):
        call()
