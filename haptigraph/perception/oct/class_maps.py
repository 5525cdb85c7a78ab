"""From class probabilities to surfaces, row by column.

Knows no network and no millimetres. Pixels are those of the maps; `Scaling` leads to those of the image.
"""

from typing import NamedTuple

import numpy as np

from haptigraph.geometry import Vec
from haptigraph.imaging import FloatImage, Floats, Mask
from haptigraph.perception.oct.shortest_path import best_path

__all__ = ["Rows", "Scaling", "border_rows", "line_rows"]

NEAR = 8  # rows on either side that speak for a border
FINE = 4  # and those that say where between two rows it lies
LEAST = np.float32(1e-3)  # no pixel is less probable: one speckle must not outweigh all others
STEEPEST = 6  # rows from one column to the next
STEP_COST = (0.1 * np.abs(np.arange(-STEEPEST, STEEPEST + 1))).astype(np.float32)
NEVER = np.float32(-20.0)


class Scaling(NamedTuple):
    """From the pixels of a map to those of the image it was made from."""

    across: float
    down: float

    def to_image(self, at_px: Vec) -> Vec:
        """Return where a place of the map lies in the image; (0, 0) is the centre of the first pixel."""
        return (at_px[0] + 0.5) * self.across - 0.5, (at_px[1] + 0.5) * self.down - 0.5


class Rows(NamedTuple):
    """One surface in a map."""

    rows: Floats
    """In each column, (w,); they mean nothing where it was not seen."""
    is_seen: Mask


def border_rows(above: FloatImage, below: FloatImage, least_confidence: float) -> Rows:
    """Return in which row of each column one class gives way to another.

    A place's score is the mean logarithm of the probabilities that the rows above it are of one class and
    those below it of the other; the best path through the scores is the surface. Where between two rows it
    lies, the shares of both classes say.
    """
    height, width = above.shape
    rows = np.arange(height + 1)
    first, last = np.maximum(rows - NEAR, 0), np.minimum(rows + NEAR, height)
    upper, lower = (_sums(np.log(np.maximum(side, LEAST))) for side in (above, below))
    count = np.maximum(last - first, 1)[:, None].astype(np.float32)
    score = (upper - upper[first] + lower[last] - lower) / count
    score[:FINE], score[-FINE:] = NEVER, NEVER
    path = best_path(np.ascontiguousarray(score.T), STEP_COST)
    columns = np.arange(width)
    near = np.clip(path + np.arange(-FINE, FINE)[:, None], 0, height - 1)
    over, under = above[near, columns], below[near, columns]
    share = (over / np.maximum(over + under, LEAST)).sum(axis=0)
    return Rows(path - FINE + share - 0.5, np.exp(score[path, columns]) >= least_confidence)


def line_rows(on: FloatImage, least_confidence: float) -> Rows:
    """Return the row of a thin class in each column: the middle of its probability along the best path."""
    height, width = on.shape
    path = best_path(np.ascontiguousarray(np.log(np.maximum(on, LEAST)).T), STEP_COST)
    columns = np.arange(width)
    near = np.clip(path + np.arange(-FINE, FINE + 1)[:, None], 0, height - 1)
    weight = on[near, columns]
    middle = (weight * near).sum(axis=0) / np.maximum(weight.sum(axis=0), LEAST)
    return Rows(middle, on[path, columns] >= least_confidence)


def _sums(values: FloatImage) -> FloatImage:
    """Return sums down the columns, (h + 1, w)."""
    sums = np.zeros((values.shape[0] + 1, values.shape[1]), np.float32)
    np.cumsum(values, axis=0, out=sums[1:])
    return sums
