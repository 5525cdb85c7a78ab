"""The best path through an image from left to right, by dynamic programming.

Turns a reward per pixel into one row per column that maximizes the sum of rewards less the cost of steps
(Bellman 1957), as for retinal layers in OCT: Chiu et al. 2010, Optics Express 18(18). The search runs from
both ends at once, which halves the number of steps.
"""

from typing import Any

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from haptigraph.imaging import FloatImage

__all__ = ["best_path"]

EXCLUDED = np.float32(-1e9)


def best_path(reward: FloatImage, step_cost: FloatImage) -> NDArray[np.intp]:
    """Return the row of the best path in each column, (w,).

    Args:
        reward: Reward of each pixel, (w, h), w at least 2: one row of the array per column of the image.
        step_cost: Cost of moving up or down by -(k // 2) to k // 2 rows to the next column, (k,), k odd, and
            symmetric; larger steps are excluded.
    """
    width, height = reward.shape
    middle, half = width // 2, len(step_cost) // 2
    first = middle - (width - 1 - middle)  # for an even width, the backward pass has one column less
    # Both passes share one long row, far enough apart not to interact.
    there, back = slice(0, height), slice(height + 2 * half, 2 * height + 2 * half)
    length = back.stop
    gain = np.full((middle + 1, length), EXCLUDED, np.float32)
    gain[:, there], gain[:first, back] = reward[: middle + 1], 0
    gain[first:, back] = reward[middle:][::-1]
    padded = np.full((middle + 1, length + 2 * half), EXCLUDED, np.float32)
    best = padded[:, half : half + length]
    windows: NDArray[Any] = sliding_window_view(padded, length, axis=1)  # (column, k, row)
    cost, choices = step_cost[:, None], np.empty((len(step_cost), length), np.float32)
    best[0] = gain[0]
    for before, here, worth in zip(windows[:-1], best[1:], gain[1:], strict=True):
        np.subtract(before, cost, out=choices)
        np.maximum.reduce(choices, axis=0, out=here)
        here += worth
    top = int((best[middle, there] + best[middle, back] - reward[middle]).argmax())
    left = _traced(padded, step_cost, top, 0)
    right = _traced(padded, step_cost, top + back.start, first) - back.start
    return np.concatenate((left, [top], right[::-1]))


def _traced(padded: FloatImage, step_cost: FloatImage, row: int, first: int) -> NDArray[np.intp]:
    """Trace back the rows that led to a row in the last column, from column `first` to the last but one."""
    half, rows = len(step_cost) // 2, []
    for column in range(len(padded) - 2, first - 1, -1):
        row += int((padded[column, row : row + 2 * half + 1] - step_cost).argmax()) - half
        rows.append(row)
    return np.array(rows[::-1], np.intp)
