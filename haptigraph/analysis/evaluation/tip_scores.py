"""Score the tip of a needle: known or not, far off, biased, and whether its certainty is true."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from msgspec import Struct

from haptigraph.geometry import Point, Segment, Vec, subtract, unit
from haptigraph.messages import Step
from haptigraph.projection import ImageGeometry

__all__ = ["TipError", "outside_scores", "quantiles", "spread", "tip_error", "tip_scores"]

FAR_MM = 0.3
MIN_SD_MM = 1e-6  # of a tip that is certain: its error counts all the same
QUANTILES = {"p68": 68, "p95": 95, "p997": 99.7}


class TipError(Struct, frozen=True):
    """Error of one reported tip."""

    far: bool
    along_px: float | None
    """Along the reported shaft, positive if too long; None without a shaft."""
    z: float | None
    """Error along the shaft per reported standard deviation; None without either."""


def tip_error(step: Step, true_tip_px: Vec | None, image: ImageGeometry) -> TipError | None:
    """Compare a reported tip with the true one; None if either is missing."""
    tip, line = step.observation.found.get("needle_tip"), step.observation.found.get("needle_line")
    if not isinstance(tip, Point) or true_tip_px is None:
        return None
    off = subtract(image.to_px(tip.at_mm), true_tip_px)
    far = math.hypot(*off) * image.mm_per_px > FAR_MM
    if not isinstance(line, Segment) or line.start_mm == line.end_mm:
        return TipError(far, None, None)
    shaft = unit(subtract(image.to_px(line.end_mm), image.to_px(line.start_mm)))
    along_px = off[0] * shaft[0] + off[1] * shaft[1]
    sd_mm = _sd_along_mm(step)
    z = None if sd_mm is None else abs(along_px) * image.mm_per_px / max(sd_mm, MIN_SD_MM)
    return TipError(far, along_px, z)


def tip_scores(errors: Sequence[TipError | None]) -> dict[str, Any]:
    """Summarise the errors of all images that count; None is a tip that was not reported."""
    known = [error for error in errors if error is not None]
    along_px = [error.along_px for error in known if error.along_px is not None]
    z = [error.z for error in known if error.z is not None]
    return {
        "tip_known_rate": len(known) / len(errors) if errors else None,
        "tip_far_rate": sum(error.far for error in known) / len(known) if known else None,
        "tip_bias_px": float(np.median(along_px)) if along_px else None,
        "tip_z": quantiles(z),
    }


def outside_scores(errors: Sequence[TipError | None]) -> dict[str, Any]:
    """Summarise the errors of tips that were reported while they were visible before the globe."""
    scores = tip_scores(errors)
    return {
        "outside_tips": sum(error is not None for error in errors),
        "outside_far_rate": scores["tip_far_rate"],
        "outside_z": scores["tip_z"],
    }


def spread(errors: Sequence[float]) -> dict[str, float | None]:
    """Return median and 95th percentile; None if the sequence is empty."""
    if not errors:
        return {"median": None, "p95": None}
    return {"median": float(np.median(errors)), "p95": float(np.percentile(errors, 95))}


def quantiles(z: Sequence[float]) -> dict[str, float | None]:
    """Return the 68, 95 and 99.7 % quantiles of errors in standard deviations; None without any."""
    return {name: float(np.percentile(z, share)) if z else None for name, share in QUANTILES.items()}


def _sd_along_mm(step: Step) -> float | None:
    """Return the reported standard deviation of the tip along the shaft."""
    certainty = step.observation.certainty
    return certainty.tip_sd_mm if certainty else None
