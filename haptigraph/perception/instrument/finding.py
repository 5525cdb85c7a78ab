"""Find an instrument in a volume by registering its model."""

import numpy as np

from haptigraph.errors import BadInput
from haptigraph.messages import Volume
from haptigraph.perception.instrument.alignment import Alignment, align
from haptigraph.perception.instrument.first_estimate import estimate_first
from haptigraph.perception.instrument.model import InstrumentModel, InstrumentPose
from haptigraph.perception.instrument.rotations import Array, rotation_matrix, rotation_vector
from haptigraph.perception.native.volume import reduce_volume

__all__ = ["find_instrument"]

MIN_INSIDE = 0.5
"""Share of the template that must be inside the volume."""
RESTARTS_MM = (0.35, -0.35)
"""Along the axis, from the first estimate of the tip, if the first registration fails."""
UP = np.array([0.0, 1.0, 0.0])


def find_instrument(volume: Volume, model: InstrumentModel) -> InstrumentPose | None:
    """Find an instrument that is alone in its volume.

    Args:
        volume: (rows, slices, columns), of as many rows as those of which the model was learned.
        model: Of the instrument.

    Returns:
        Its pose, or None if no registration fits: the needle is absent, or its place is not known.

    Raises:
        BadInput: If the volume does not have the model's rows.
    """
    if volume.ndim != 3 or volume.dtype != np.uint8 or volume.shape[0] != model.rows:
        shape = f"{volume.dtype} of shape {volume.shape}"
        raise BadInput(
            f"the instrument was learned from volumes of uint8 with {model.rows} rows; found {shape}"
        )
    reduced = reduce_volume(volume, model.is_usable)
    first = estimate_first(reduced, model.rows, model.voxel_mm, model.level)
    if first is None:
        return None
    for rotation, origin_mm in _starts(first.tip_mm, first.heading_deg, model):
        found = align(reduced, model.template, model.rows, model.voxel_mm, rotation, origin_mm)
        if found.inside >= MIN_INSIDE and found.cost <= model.cost_limit:
            return _pose(found, model)
    return None


def _starts(tip_mm: Array, heading_deg: float, model: InstrumentModel) -> list[tuple[Array, Array]]:
    """Return where to start: at the learned orientation, shifted along the axis, turned to the heading."""
    learned_deg = float(np.rad2deg(np.arctan2(model.axis[2], model.axis[0])))
    upright: Array = np.eye(3)
    turned = rotation_matrix(UP * np.deg2rad(learned_deg - heading_deg))
    at = tip_mm - model.start_mm
    shifted = [(upright, at + shift * model.axis) for shift in RESTARTS_MM]
    return [(upright, at), *shifted, (turned, tip_mm - turned @ model.start_mm)]


def _pose(found: Alignment, model: InstrumentModel) -> InstrumentPose:
    return InstrumentPose(
        tip_mm=found.origin_mm,
        axis=found.rotation @ model.axis,
        bevel=found.rotation @ model.bevel,
        rotation=found.rotation,
        roll_deg=float(np.rad2deg(rotation_vector(found.rotation) @ model.axis)),
        tip_sd_mm=model.tip_sd_mm,
        axis_sd_deg=model.axis_sd_deg,
        roll_sd_deg=model.roll_sd_deg,
        cost=found.cost,
    )
