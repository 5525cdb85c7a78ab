"""The best path, compared with an exhaustive search."""

from itertools import product

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from haptigraph.perception.native.bscan import best_path


@settings(max_examples=40)
@given(st.integers(2, 5), st.integers(0, 2**31), st.floats(0, 2))
def test_no_other_path_has_a_larger_reward(width, seed, cost):
    reward = np.random.default_rng(seed).normal(size=(width, 4)).astype(np.float32)
    step_cost = (cost * np.arange(-1, 2) ** 2).astype(np.float32)

    def total_reward(path) -> float:
        steps = np.diff(path)
        if np.abs(steps).max(initial=0) > 1:
            return -np.inf
        return float(reward[np.arange(width), path].sum() - step_cost[steps + 1].sum())

    found = total_reward(best_path(reward, step_cost))
    assert found > -np.inf
    assert found >= max(total_reward(np.array(path)) for path in product(range(4), repeat=width)) - 1e-4


@given(st.integers(2, 40), st.integers(0, 2**31))
def test_the_path_is_the_same_in_either_direction(width, seed):
    reward = np.random.default_rng(seed).normal(size=(width, 12)).astype(np.float32)
    step_cost = (0.3 * np.arange(-2, 3) ** 2).astype(np.float32)
    forward, backward = best_path(reward, step_cost), best_path(np.ascontiguousarray(reward[::-1]), step_cost)
    assert np.array_equal(forward, backward[::-1])
