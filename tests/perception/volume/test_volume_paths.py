"""Best paths through all slices at once."""

import itertools

import numpy as np
import pytest

from haptigraph.perception.oct.shortest_path import best_path
from haptigraph.perception.volume.paths import best_paths

COST = (2.0 * np.arange(-2, 3) ** 2).astype(np.float32)


def total(reward, rows):
    steps = np.diff(rows)
    return sum(reward[column, row] for column, row in enumerate(rows)) - 2.0 * (steps**2).sum()


@pytest.mark.parametrize("seed", range(4))
def test_every_path_is_the_best_of_all(seed):
    reward = np.random.default_rng(seed).normal(0, 4, (5, 6, 3)).astype(np.float32)
    rows = best_paths(reward, COST)
    for slice_, path in enumerate(rows):
        possible = [
            rows for rows in itertools.product(range(6), repeat=5) if np.abs(np.diff(rows)).max() <= 2
        ]
        best = max(total(reward[:, :, slice_], rows) for rows in possible)
        assert total(reward[:, :, slice_], path) == pytest.approx(best, abs=1e-4)


def test_slices_do_not_interact_and_agree_with_the_path_of_one_b_scan():
    reward = np.random.default_rng(9).normal(0, 4, (20, 30, 4)).astype(np.float32)
    rows = best_paths(reward, COST)
    for slice_ in range(4):
        alone = best_path(np.ascontiguousarray(reward[:, :, slice_]), COST)
        assert total(reward[:, :, slice_], rows[slice_]) == pytest.approx(
            total(reward[:, :, slice_], alone), abs=1e-3
        )
