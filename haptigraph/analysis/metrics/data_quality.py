"""Measure the quality of a trial's data: images per second, late and skipped images, a tip not visible.

The measures cover the run, or the whole trial if no run started.
"""

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from haptigraph.analysis.metrics.run import RunMeasures
from haptigraph.geometry import Point
from haptigraph.messages import Step

__all__ = ["LONG_GAP_NS", "DataQuality"]

LONG_GAP_NS = 500_000_000
"""A longer gap interrupts the movement."""
LATE = 1.5
"""An image is late if it comes after so many times the median interval."""


class _Seen(Struct, frozen=True):
    stamp_ns: int
    index: int
    has_tip: bool


class DataQuality:
    """Collect the steps of a trial; `measures` describes their quality.

    Args:
        run: The measures of the run, updated before each `add`.
    """

    def __init__(self, run: RunMeasures) -> None:
        self._run, self._has_begun = run, False
        self._seen: list[_Seen] = []

    def add(self, step: Step) -> None:
        """Add the next step, after the run's measures have processed it."""
        run = self._run
        if run.ended_ns is not None and step.stamp_ns > run.ended_ns:
            return
        if run.started_ns is not None and not self._has_begun:
            self._has_begun, self._seen = True, []
        tip = step.observation.found.get(run.span.begins[0])
        self._seen.append(_Seen(step.stamp_ns, step.index, isinstance(tip, Point)))

    def longest_gap_ns(self) -> int:
        """Return the longest interval without a visible tip, from image to image or to an end of the run."""
        return int(self._gaps_ns().max(initial=0))

    def measures(self) -> dict[str, float | int]:
        """Return the measures by name; empty if there is no interval between two steps.

        A step lasts until the next one. A step that repeats the number of the last image has no image.
        """
        stamps_ns = np.array([each.stamp_ns for each in self._seen], np.int64)
        if len(stamps_ns) < 2 or stamps_ns[-1] == stamps_ns[0]:
            return {}
        duration_ns = int(stamps_ns[-1] - stamps_ns[0])
        ahead = np.diff([each.index for each in self._seen])
        lasted_ns = np.diff(stamps_ns)
        is_unseen = ~np.array([each.has_tip for each in self._seen])[:-1]
        has_image = ahead != 0
        intervals_ns = np.diff(stamps_ns[np.concatenate([[True], has_image])])
        late = intervals_ns > LATE * np.median(intervals_ns) if has_image.any() else np.ones(1)
        return {
            "images_per_s": 1e9 * int(has_image.sum()) / duration_ns,
            "late_images_fraction": float(late.mean()),
            "skipped_images": int((ahead - 1).clip(0).sum()),
            "unseen_fraction": float(lasted_ns[is_unseen].sum() / duration_ns),
            "long_gaps": int((self._gaps_ns() > LONG_GAP_NS).sum()),
            "longest_gap_s": self.longest_gap_ns() / 1e9,
        }

    def _gaps_ns(self) -> NDArray[np.int64]:
        seen, last = self._seen, len(self._seen) - 1
        ends = (0, last)
        return np.diff([each.stamp_ns for n, each in enumerate(seen) if each.has_tip or n in ends])
