"""Surfaces from maps of class probabilities, as one row per column.

Coordinates are pixels of the maps; `Scaling` converts them to pixels of the image.
"""

from typing import NamedTuple

import numpy as np

from haptigraph.geometry import Vec
from haptigraph.imaging import FloatImage, Floats, Mask
from haptigraph.perception.oct.shortest_path import best_path

__all__ = ["Rows", "Scaling", "border_rows", "line_rows"]

SCORED_ROWS = 8  # on either side of a border, for its score
REFINED_ROWS = 4  # on either side of a border, for its sub-pixel position
MIN_PROBABILITY = np.float32(1e-3)  # lower limit, so that a single speckle does not outweigh all others
MAX_STEP_ROWS = 6  # from one column to the next
STEP_COST = (0.1 * np.abs(np.arange(-MAX_STEP_ROWS, MAX_STEP_ROWS + 1))).astype(np.float32)
EXCLUDED = np.float32(-20.0)


class Scaling(NamedTuple):
    """Scale from pixels of a map to pixels of the image it was made from."""

    across: float
    down: float

    def to_image(self, at_px: Vec) -> Vec:
        """Convert a point of the map to the image; (0, 0) is the centre of the first pixel."""
        return (at_px[0] + 0.5) * self.across - 0.5, (at_px[1] + 0.5) * self.down - 0.5


class Rows(NamedTuple):
    """One surface in a map."""

    rows: Floats
    """In each column, (w,); undefined where the surface is not visible."""
    is_visible: Mask


def border_rows(above: FloatImage, below: FloatImage, least_confidence: float) -> Rows:
    """Return the row of the border between two classes in each column.

    A row's score is the mean log probability that the rows above it are of one class and those below it of
    the other; the best path through the scores is the surface. The shares of both classes near it give its
    sub-pixel position.
    """
    height, width = above.shape
    rows = np.arange(height + 1)
    first, last = np.maximum(rows - SCORED_ROWS, 0), np.minimum(rows + SCORED_ROWS, height)
    upper, lower = (_sums(np.log(np.maximum(side, MIN_PROBABILITY))) for side in (above, below))
    count = np.maximum(last - first, 1)[:, None].astype(np.float32)
    score = (upper - upper[first] + lower[last] - lower) / count
    score[:REFINED_ROWS], score[-REFINED_ROWS:] = EXCLUDED, EXCLUDED
    path = best_path(np.ascontiguousarray(score.T), STEP_COST)
    columns = np.arange(width)
    near = np.clip(path + np.arange(-REFINED_ROWS, REFINED_ROWS)[:, None], 0, height - 1)
    over, under = above[near, columns], below[near, columns]
    share = (over / np.maximum(over + under, MIN_PROBABILITY)).sum(axis=0)
    return Rows(path - REFINED_ROWS + share - 0.5, np.exp(score[path, columns]) >= least_confidence)


def line_rows(probability: FloatImage, least_confidence: float) -> Rows:
    """Return the row of a thin class in each column: the centroid of its probability along the best path."""
    height, width = probability.shape
    path = best_path(np.ascontiguousarray(np.log(np.maximum(probability, MIN_PROBABILITY)).T), STEP_COST)
    columns = np.arange(width)
    near = np.clip(path + np.arange(-REFINED_ROWS, REFINED_ROWS + 1)[:, None], 0, height - 1)
    weight = probability[near, columns]
    middle = (weight * near).sum(axis=0) / np.maximum(weight.sum(axis=0), MIN_PROBABILITY)
    return Rows(middle, probability[path, columns] >= least_confidence)


def _sums(values: FloatImage) -> FloatImage:
    """Return cumulative sums down the columns, (h + 1, w)."""
    sums = np.zeros((values.shape[0] + 1, values.shape[1]), np.float32)
    np.cumsum(values, axis=0, out=sums[1:])
    return sums
