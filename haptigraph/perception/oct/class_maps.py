"""Surfaces from maps of class probabilities, as one row per column.

Coordinates are pixels of the maps; `Scaling` converts them to pixels of the image and to millimetres. Where
the classes contradict a surface (the class that belongs below it lies above it, or the reverse), it does not
count as visible.
"""

from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from haptigraph.geometry import Vec
from haptigraph.imaging import FloatImage, Floats, Mask
from haptigraph.perception.native.bscan import best_path

__all__ = ["Rows", "Scaling", "border_rows", "line_rows", "without_neighbours"]

SCORED_MM, SCORED_ROWS = 0.05, (3, 16)  # on either side of a border, for its score; limits of the rows
REFINED_ROWS = 4  # on either side of a border, for its sub-pixel position
MIN_PROBABILITY = np.float32(1e-3)  # lower limit, so that a single speckle does not outweigh all others
MAX_STEP_ROWS = 6  # from one column to the next
STEP_COST = (0.1 * np.abs(np.arange(-MAX_STEP_ROWS, MAX_STEP_ROWS + 1))).astype(np.float32)
EXCLUDED = np.float32(-20.0)
LIKELY = np.float32(-3.0)  # rows in which no column scores as much are not searched
CHECKED_ABOVE_MM, CHECKED_BELOW_MM = 0.3, 0.15  # searched for contradicting classes
MAX_WRONG_ABOVE_MM, MAX_WRONG_BELOW_MM = 0.004, 0.03  # a surface that is too deep is the worse error
JUMP_ROWS = 4  # a larger step joins two different borders
DOUBTFUL_COLUMNS = 2  # left out on either side of one that is
MAX_ELSEWHERE = 0.3  # probability of a line's class apart from the best path, relative to that on it


class Scaling(NamedTuple):
    """Scale from pixels of a map to pixels of the image it was made from, and to millimetres."""

    across: float
    down: float
    lateral_mm: float
    """Of one pixel of the image."""
    axial_mm: float

    @property
    def column_mm(self) -> float:
        """Width of one pixel of the map."""
        return self.across * self.lateral_mm

    @property
    def row_mm(self) -> float:
        """Height of one pixel of the map."""
        return self.down * self.axial_mm

    def to_image(self, at_px: Vec) -> Vec:
        """Convert a point of the map to the image; (0, 0) is the centre of the first pixel."""
        return (at_px[0] + 0.5) * self.across - 0.5, (at_px[1] + 0.5) * self.down - 0.5


class Rows(NamedTuple):
    """One surface in a map."""

    rows: Floats
    """In each column, (w,); undefined where the surface is not visible."""
    is_visible: Mask
    is_likely: Mask
    """Where it is probable enough, also where the classes contradict each other."""


def border_rows(
    above: FloatImage, below: FloatImage, least_confidence: float, row_mm: float, depth_cost: float = 1.0
) -> Rows:
    """Return the row of the border between two classes in each column.

    A row's score is the mean log probability that the rows above it are of one class and those below it of
    the other; the best path through the scores is the surface. The shares of both classes near it give its
    sub-pixel position.

    Args:
        above: Probability of the class above the border, (h, w).
        below: Probability of the class below it, (h, w).
        least_confidence: Minimum geometric mean of both probabilities where the border is visible.
        row_mm: Height of one row.
        depth_cost: Of a border that is too deep, relative to one that is too high.
    """
    above, below = _cautious(above, below, np.float32(depth_cost))
    height, width = above.shape
    scored = int(np.clip(round(SCORED_MM / row_mm), *SCORED_ROWS))
    rows = np.arange(height + 1)
    first, last = np.maximum(rows - scored, 0), np.minimum(rows + scored, height)
    upper, lower = (_sums(np.log(np.maximum(side, MIN_PROBABILITY))) for side in (above, below))
    count = np.maximum(last - first, 1)[:, None].astype(np.float32)
    score = (upper - upper[first] + lower[last] - lower) / count
    score[:REFINED_ROWS], score[-REFINED_ROWS:] = EXCLUDED, EXCLUDED
    likely = np.flatnonzero(score.max(axis=1) > LIKELY)
    if len(likely) < 2:
        return Rows(np.zeros(width), np.zeros(width, bool), np.zeros(width, bool))
    start, end = int(likely[0]), int(likely[-1]) + 1
    path = np.asarray(start + best_path(np.ascontiguousarray(score[start:end].T), STEP_COST), np.intp)
    columns = np.arange(width)
    near = np.clip(path + np.arange(-REFINED_ROWS, REFINED_ROWS)[:, None], 0, height - 1)
    over, under = above[near, columns], below[near, columns]
    share = (over / np.maximum(over + under, MIN_PROBABILITY)).sum(axis=0)
    is_likely = np.exp(score[path, columns]) >= least_confidence
    is_visible = is_likely & _is_consistent(above, below, path, row_mm) & _is_continuous(path)
    return Rows(path - REFINED_ROWS + share - 0.5, without_neighbours(is_visible), is_likely)


def _cautious(above: FloatImage, below: FloatImage, depth_cost: np.float32) -> tuple[FloatImage, FloatImage]:
    """Weigh the class below a border more, so that where the network is undecided the border is higher."""
    both, weighted = above + below, depth_cost * below
    share = weighted / np.maximum(above + weighted, MIN_PROBABILITY)
    return np.asarray(both * (1 - share), np.float32), np.asarray(both * share, np.float32)


def _is_consistent(above: FloatImage, below: FloatImage, path: NDArray[np.intp], row_mm: float) -> Mask:
    """Return the columns in which little of either class lies on the wrong side of a border."""
    height, width = above.shape
    columns = np.arange(width)
    up, down = (round(length_mm / row_mm) for length_mm in (CHECKED_ABOVE_MM, CHECKED_BELOW_MM))
    wrong_above, wrong_below = _sums(below), _sums(above)
    too_high = wrong_above[path, columns] - wrong_above[np.maximum(path - up, 0), columns]
    too_low = wrong_below[np.minimum(path + down, height), columns] - wrong_below[path, columns]
    limits = np.array([MAX_WRONG_ABOVE_MM, MAX_WRONG_BELOW_MM]) / row_mm + 1.0
    return np.asarray((too_high <= limits[0]) & (too_low <= limits[1]))


def _is_continuous(path: NDArray[np.intp]) -> Mask:
    """Return the columns that are not beside a jump."""
    jumps = np.abs(np.diff(path)) > JUMP_ROWS
    return np.asarray(~(np.append(jumps, False) | np.append(False, jumps)))


def without_neighbours(is_visible: Mask) -> Mask:
    """Leave out columns beside those that are left out: what misled the network there is near."""
    kernel = np.ones((1, 2 * DOUBTFUL_COLUMNS + 1), np.uint8)
    return np.asarray(cv2.erode(is_visible.astype(np.uint8)[None], kernel)[0] > 0)


def line_rows(probability: FloatImage, least_confidence: float) -> Rows:
    """Return the row of a thin class in each column: the centroid of its probability along the best path."""
    height, width = probability.shape
    reward = np.ascontiguousarray(np.log(np.maximum(probability, MIN_PROBABILITY)).T)
    path = np.asarray(best_path(reward, STEP_COST), np.intp)
    columns = np.arange(width)
    near = np.clip(path + np.arange(-REFINED_ROWS, REFINED_ROWS + 1)[:, None], 0, height - 1)
    weight = probability[near, columns]
    on_path = weight.sum(axis=0)
    middle = (weight * near).sum(axis=0) / np.maximum(on_path, MIN_PROBABILITY)
    is_likely = probability[path, columns] >= least_confidence
    is_visible = is_likely & (probability.sum(axis=0) - on_path <= MAX_ELSEWHERE * on_path)
    return Rows(middle, is_visible & _is_continuous(path), is_likely)


def _sums(values: FloatImage) -> FloatImage:
    """Return cumulative sums down the columns, (h + 1, w)."""
    sums = np.zeros((values.shape[0] + 1, values.shape[1]), np.float32)
    np.cumsum(values, axis=0, out=sums[1:])
    return sums
