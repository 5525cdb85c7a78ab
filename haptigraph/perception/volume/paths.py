"""The best paths through all slices of a volume at once, from left to right, by dynamic programming.

Turns a reward per voxel into one row per column and slice that maximizes the sum of rewards less the cost of
steps (Bellman 1957), for each slice on its own.
"""

import numpy as np
from numpy.typing import NDArray

from haptigraph.imaging import FloatImage

__all__ = ["best_paths"]

EXCLUDED = np.float32(-1e9)


def best_paths(reward: FloatImage, step_cost: FloatImage) -> NDArray[np.intp]:
    """Return the row of the best path in each column and slice, (n, w).

    Args:
        reward: Reward of each voxel, (w, h, n).
        step_cost: Cost of moving up or down by -(k // 2) to k // 2 rows to the next column, (k,), k odd.
    """
    width, height, slices = reward.shape
    half = len(step_cost) // 2
    padded = np.full((width, height + 2 * half, slices), EXCLUDED, np.float32)
    best = padded[:, half : half + height]
    best[0] = reward[0]
    choice = np.empty((height, slices), np.float32)
    for column in range(1, width):
        here = best[column]
        np.subtract(padded[column - 1, :height], step_cost[0], out=here)
        for shift, cost in enumerate(step_cost[1:], 1):
            np.subtract(padded[column - 1, shift : shift + height], cost, out=choice)
            np.maximum(here, choice, out=here)
        here += reward[column]
    rows = np.empty((width, slices), np.intp)
    rows[-1] = best[-1].argmax(axis=0)
    numbers, shifts = np.arange(slices), np.arange(len(step_cost))[:, None]
    for column in range(width - 2, -1, -1):
        near = padded[column, rows[column + 1] + shifts, numbers] - step_cost[:, None]
        rows[column] = rows[column + 1] + near.argmax(axis=0) - half
    return rows.T
