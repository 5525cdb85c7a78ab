"""A needle of which a model was learned, alone in its volume, in the form of those that `shaft` finds."""

import math

import numpy as np

from haptigraph.messages import Volume
from haptigraph.perception.instrument.finding import find_instrument
from haptigraph.perception.instrument.model import InstrumentModel
from haptigraph.perception.volume.scale import VolumeScale
from haptigraph.perception.volume.shaft import FoundNeedle, entry_mm

__all__ = ["find_learned_needle"]


def find_learned_needle(volume: Volume, model: InstrumentModel, scale: VolumeScale) -> FoundNeedle | None:
    """Register a model to a volume.

    Args:
        volume: (rows, slices, columns).
        model: Of the instrument, learned from volumes of this size.
        scale: Size and scale of the volume.

    Returns:
        The needle; None if no registration fits.
    """
    pose = find_instrument(volume, model)
    if pose is None:
        return None
    tip_mm, along = np.asarray(pose.tip_mm, np.float64), np.asarray(pose.axis, np.float64)
    return FoundNeedle(
        start_mm=entry_mm(scale, tip_mm, along),
        end_mm=tip_mm,
        along=along,
        direction_sd_deg=pose.axis_sd_deg,
        radius_mm=math.nan,
        tip_mm=tip_mm,
        tip_cov_mm2=np.diag(np.square(pose.tip_sd_mm)),
        facing=np.asarray(pose.bevel, np.float64),
        confidence=max(1 - pose.cost / model.cost_limit, 0.0),
    )
