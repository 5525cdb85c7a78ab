"""Simulated profiles of grey across an RPE that the U-Net found: is it too deep there?

The U-Net is given simulated B-scans, of which the true RPE is known. `train_profiles` learns from its errors.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from haptigraph.perception.oct.class_edges import averaged, strip, upper_edge
from haptigraph.perception.oct.class_maps import Scaling
from haptigraph.perception.oct.onnx_model import OnnxModel
from haptigraph.perception.oct.segmentation import likely_layers
from haptigraph.sim.oct.diseased import random_detailed_scene
from haptigraph.sim.oct.scenes import PLACES, BscanScene, random_scene

__all__ = ["KINDS", "Judged", "judge", "scene_of"]

TRAINING_SEED = 700
KINDS = {"diseased": 11000, "healthy": 2000, "needle": 2000, "plain": 4000}
"""Number of B-scans of each kind."""
DEEP_MM = 0.01  # an RPE deeper than this is too deep; the score allows 5 px, 11 to 22 µm
EDGE_PX = 8  # an RPE nearer to the image's upper or lower border is not learned from


class Judged(NamedTuple):
    """The RPE of one B-scan that the U-Net found."""

    grey: NDArray[np.uint8]
    """Near it, (samples, n)."""
    levels: tuple[float, float]
    """Dark and bright in the image."""
    column_mm: float
    is_likely: NDArray[np.bool_]
    """Columns in which it was found, (n,)."""
    is_inside: NDArray[np.bool_]
    """Columns in which the true RPE is inside the image, (n,)."""
    is_deep: NDArray[np.bool_]
    """Whether it is too deep there, or in a needle's shadow."""

    @property
    def is_learned(self) -> NDArray[np.bool_]:
        """Columns that are learned from, (n,)."""
        return self.is_likely & self.is_inside

    def profiles(self) -> NDArray[np.float16]:
        """Return what the network is given, (n, values)."""
        return averaged(self.grey, self.levels, self.column_mm, self.is_likely).astype(np.float16)


def scene_of(kind: str, number: int, seed: int = TRAINING_SEED) -> BscanScene:
    """Return a scene of one of `KINDS`; every second one of those with needle is diseased."""
    if kind == "plain":
        return random_scene(number, seed)
    if kind == "needle":
        return random_detailed_scene(number, seed, diseased=number % 2 == 0, place=PLACES[number % 3])
    return random_detailed_scene(number, seed, diseased=kind == "diseased")


def judge(model: OnnxModel, scene: BscanScene) -> Judged:
    """Compare the RPE that a network finds with the true one."""
    scan = scene.take()
    scale_mm = scene.scan.lateral_mm_per_px, scene.scan.axial_mm_per_px
    maps = model(scan.image)
    _, height, width = maps.shape
    scaling = Scaling(scan.image.shape[1] / width, scan.image.shape[0] / height, *scale_mm)
    *_, found = likely_layers(maps, model.spec, scaling)
    row_px, _ = upper_edge(scan.image, found.rpe_px, scale_mm)
    grey, levels = strip(scan.image, row_px, scale_mm)
    columns = np.arange(scan.image.shape[1])
    true_px = np.interp(found.x_px, columns, scan.truth.rpe_px)
    is_lit = scan.truth.rpe_lit[np.rint(found.x_px).astype(np.intp)]
    return Judged(
        grey=np.rint(grey).astype(np.uint8),
        levels=levels,
        column_mm=scan.image.shape[1] * scale_mm[0] / len(row_px),
        is_likely=found.rpe_visible,
        is_inside=(true_px > EDGE_PX) & (true_px < len(scan.image) - EDGE_PX),
        is_deep=((row_px - true_px) * scale_mm[1] > DEEP_MM) | ~is_lit,
    )
