"""Score a network on simulated B-scans without needle, healthy and diseased: is anything invented?"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from haptigraph.perception.oct.onnx_model import OnnxModel
from haptigraph.perception.oct.segmentation import interpret
from haptigraph.sim.oct.diseased import random_detailed_scene
from haptigraph.sim.oct.scenes import BscanScene
from training.score import is_inside, rows_by_column

__all__ = [
    "DEEP_PX",
    "EMPTY_SEED",
    "MAX_SCAN_SHARE",
    "EmptyScan",
    "EmptyTotals",
    "empty_totals",
    "score_empty",
]

EMPTY_SEED = 400
DEEP_PX, MAX_SCAN_SHARE = 5, 0.05
"""An RPE reported deeper than this is unsafe; largest share of a scan's width in which it may be."""


class EmptyScan(NamedTuple):
    """One scored B-scan without needle."""

    number: int
    diseased: bool
    has_needle: bool
    """Whether one was reported, wrongly."""
    rpe_error_px: NDArray[np.float64]
    """Reported less true row in every column; nan where it was not reported or is outside the image, (w,)."""
    ilm_error_px: NDArray[np.float64]

    @property
    def deep_share(self) -> float:
        """Share of the scan's width in which the RPE was reported too deep."""
        return float((self.rpe_error_px > DEEP_PX).mean())

    def scene(self, seed: int = EMPTY_SEED) -> BscanScene:
        """Return its scene."""
        return random_detailed_scene(self.number, seed, diseased=self.diseased)


class EmptyTotals(NamedTuple):
    """Scores of many B-scans without needle."""

    scans: int
    needles: int
    deep_share: float
    """Share of columns in which the RPE was reported too deep."""
    worst_share: float
    """Of one scan's columns."""
    scans_over: int
    """Number of scans with more than `MAX_SCAN_SHARE`."""
    found_share: float
    """Of the RPE's columns inside the image."""
    rpe_px: tuple[float, float]
    """Median and 95th percentile of its absolute error."""
    ilm_px: tuple[float, float]


def score_empty(model: OnnxModel, count: int, *, diseased: bool, seed: int = EMPTY_SEED) -> list[EmptyScan]:
    """Score `count` B-scans without needle."""
    scored = []
    for number in range(count):
        scene = random_detailed_scene(number, seed, diseased=diseased)
        scan = scene.take()
        scale_mm = scene.scan.lateral_mm_per_px, scene.scan.axial_mm_per_px
        found, shaft = interpret(model(scan.image), model, scan.image, scale_mm)
        rpe, ilm = (
            np.where(is_inside(true), rows_by_column(found.x_px, row, is_visible) - true, np.nan)
            for row, is_visible, true in (
                (found.rpe_px, found.rpe_visible, scan.truth.rpe_px),
                (found.ilm_px, found.ilm_visible, scan.truth.ilm_px),
            )
        )
        scored.append(EmptyScan(number, diseased, shaft is not None, rpe, ilm))
    return scored


def empty_totals(scored: list[EmptyScan]) -> EmptyTotals:
    """Pool the scores."""
    shares = np.array([scan.deep_share for scan in scored])
    rpe, ilm = (
        np.array([getattr(scan, name) for scan in scored]) for name in ("rpe_error_px", "ilm_error_px")
    )
    return EmptyTotals(
        scans=len(scored),
        needles=sum(scan.has_needle for scan in scored),
        deep_share=float(shares.mean()),
        worst_share=float(shares.max()),
        scans_over=int((shares > MAX_SCAN_SHARE).sum()),
        found_share=float(np.isfinite(rpe).mean()),
        rpe_px=_median_and_p95(rpe),
        ilm_px=_median_and_p95(ilm),
    )


def _median_and_p95(error_px: NDArray[np.float64]) -> tuple[float, float]:
    known = np.abs(error_px[np.isfinite(error_px)])
    return float(np.median(known)), float(np.percentile(known, 95))
