"""The perceiver `segmentation`: ILM, RPE and needle of a B-scan, by a neural network.

Turns an image (px) into positions (eye frame, mm), by the pixel classes of a network of any origin. Its
observations are built by the same code as those of the perceiver `bscan`. Every image is processed
independently.
"""

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from haptigraph.config import PerceptionConfig
from haptigraph.imaging import FloatImage
from haptigraph.messages import Capture, ImageKind, Observation
from haptigraph.perception.entities import ENTITIES
from haptigraph.perception.oct.class_maps import Rows, Scaling, border_rows, line_rows
from haptigraph.perception.oct.class_needle import NeedleFit, fit_needles
from haptigraph.perception.oct.needle import BEVEL_PX, EDGE_SD_PX, SHADOW_MARGIN_PX, row_at
from haptigraph.perception.oct.onnx_model import EntityClasses, ModelFile, OnnxModel, SurfaceClass
from haptigraph.perception.oct.scan_geometry import Layers, ObservationBuilder, Shaft, casts_shadow
from haptigraph.perception.oct.surfaces import without_specks
from haptigraph.registration.oct import ScanRegistration

__all__ = ["SegmentationPerceiver", "interpret"]

COLUMNS = 128  # largest number of columns in which surfaces are sampled
ILM_MARGIN_PX = 8.0  # nearer to the ILM than this, the needle may continue in tissue, where it is not visible
MIN_SHIFT_PX = 6.0  # nearer to the shadow's edge than this, the end of the needle's class is more precise
SLOPE_COLUMNS, EDGE_COLUMNS = 8, 24  # used to extrapolate the RPE into the shadow; searched for the edge
RPE_ROWS = -6, 3  # of the map, around the RPE
HALF = 0.5
MAX_DEPTH_PX = 220.0  # of the tip below the end of the needle's class
HIDDEN_TIP_SD_PX = 12.0  # standard deviation of a tip that is not visible


class SegmentationPerceiver:
    """Find ILM, RPE and needle.

    Args:
        registration: Size and scale of the B-scans, and the depth of the target.
        config: `model` is the path of the network's TOML file.

    Raises:
        MissingExtra: If ONNX Runtime is not installed.
        BadInput: If the network cannot be used.
    """

    images: ImageKind = "bscan"
    entities = ENTITIES["segmentation"]
    entities_with_sd = frozenset(("needle_tip", "needle_line"))

    def __init__(self, registration: ScanRegistration, config: PerceptionConfig) -> None:
        self._registration = registration
        self._model = OnnxModel(config.model)
        self._build_observation = ObservationBuilder(registration)

    def reset(self) -> None:
        """Do nothing: every image is processed independently."""

    def __call__(self, capture: Capture) -> Observation:
        """Process one image.

        Raises:
            BadInput: If it is not a B-scan of the registered size.
        """
        image = self._registration.checked(capture.image)
        size_px = image.shape[1], image.shape[0]
        layers, shaft = interpret(self._model(image), self._model.spec, size_px)
        return self._build_observation(capture.stamp_ns, layers, shaft)


def interpret(maps: FloatImage, model: ModelFile, size_px: tuple[int, int]) -> tuple[Layers, Shaft | None]:
    """Extract surfaces and needle from a network's output, in pixels of the image.

    Args:
        maps: Probability of each class, (classes, h, w).
        model: Meaning of the classes.
        size_px: (width, height) of the image.
    """
    _, height, width = maps.shape
    scaling = Scaling(size_px[0] / width, size_px[1] / height)
    every = max(1, width // COLUMNS)
    columns = np.arange(width // every) * every + (every - 1) / 2
    entity, least_confidence = model.entity, model.least_confidence
    ilm, rpe = (_surface(maps, which, every, least_confidence) for which in (entity.ilm, entity.rpe))
    layers = Layers(
        x_px=(columns + 0.5) * scaling.across - 0.5,
        ilm_px=(ilm.rows + 0.5) * scaling.down - 0.5,
        ilm_visible=without_specks(ilm.is_visible),
        rpe_px=(rpe.rows + 0.5) * scaling.down - 0.5,
        rpe_visible=without_specks(rpe.is_visible & (rpe.rows > ilm.rows)),
    )
    return layers, _shaft(maps, model, layers, scaling)


def _surface(maps: FloatImage, which: SurfaceClass | None, every: int, threshold: float) -> Rows:
    if which is None:
        count = maps.shape[2] // every
        return Rows(np.zeros(count), np.zeros(count, bool))
    coarse = [_coarser(maps[index], every) for index in which.indices]
    return border_rows(coarse[0], coarse[1], threshold) if which.between else line_rows(coarse[0], threshold)


def _coarser(values: FloatImage, every: int) -> FloatImage:
    """Average groups of `every` columns."""
    height, width = values.shape
    kept = values[:, : width // every * every]
    return np.asarray(cv2.resize(kept, (width // every, height), interpolation=cv2.INTER_AREA), np.float32)


def _shaft(maps: FloatImage, model: ModelFile, layers: Layers, scaling: Scaling) -> Shaft | None:
    """Return the needle: the line with most evidence among those that cast a shadow."""
    if model.entity.needle is None:
        return None
    for fit in fit_needles(maps[model.entity.needle.index], scaling, model.least_confidence):
        shaft = _as_shaft(fit)
        if casts_shadow(shaft, layers):
            return _with_tip(shaft, _tissue(maps, model.entity), layers, scaling)
    return None


def _tissue(maps: FloatImage, entity: EntityClasses) -> FloatImage:
    """Return the probability of tissue that is visible only in the light, (h, w)."""
    rpe, ilm = entity.rpe, entity.ilm
    inside = set() if rpe is None else set(rpe.indices)
    inside |= {ilm.between[1]} if ilm is not None and ilm.between else set()
    return np.asarray(sum((maps[index] for index in inside), np.zeros_like(maps[0])), np.float32)


def _as_shaft(fit: NeedleFit) -> Shaft:
    (x, y), (start_x, start_y) = fit.tip_px, fit.entry_px
    length_px = math.hypot(x - start_x, y - start_y)
    dx, dy = (x - start_x) / length_px, (y - start_y) / length_px
    return Shaft(
        tip_px=fit.tip_px,
        start_px=fit.entry_px,
        along_px=(dx, dy),
        sd_px=(max(abs(dx) * fit.tip_sd_px, 1.0), max(abs(dy) * fit.tip_sd_px, 1.0)),
        angle_sd_deg=fit.angle_sd_deg,
        confidence=fit.confidence,
    )


def _with_tip(shaft: Shaft, tissue: FloatImage, layers: Layers, scaling: Scaling) -> Shaft:
    """Move the tip to the shadow's edge if that is beyond the visible metal, as it often is in tissue."""
    (x, y), (dx, dy) = shaft.tip_px, shaft.along_px
    slope, side = dy / max(abs(dx), 1e-3), math.copysign(1.0, dx)
    ahead_px = side * (layers.x_px - x)
    lit = np.flatnonzero(
        layers.rpe_visible & (ahead_px > -SHADOW_MARGIN_PX) & (ahead_px < MAX_DEPTH_PX / max(slope, 1e-3))
    )
    ilm_y = row_at(layers.x_px, layers.ilm_px, layers.ilm_visible, x)
    edge_x = _shadow_edge(tissue, layers, lit if side > 0 else lit[::-1], side, scaling) if len(lit) else None
    if edge_x is None:
        is_observable = y < ilm_y - ILM_MARGIN_PX
        hidden_px = HIDDEN_TIP_SD_PX, HIDDEN_TIP_SD_PX * slope
        return shaft if is_observable else shaft._replace(sd_px=hidden_px)
    further_px = side * (edge_x - x)
    is_inside = y + further_px * slope > ilm_y
    if not MIN_SHIFT_PX < further_px < (math.inf if is_inside else BEVEL_PX):
        return shaft
    return shaft._replace(
        tip_px=(edge_x, y + further_px * slope),
        sd_px=(EDGE_SD_PX, EDGE_SD_PX * slope),
    )


def _shadow_edge(
    tissue: FloatImage, layers: Layers, lit: NDArray[np.intp], side: float, scaling: Scaling
) -> float | None:
    """Return the column of the shadow's edge [px of the image]; None if it is not observable.

    Args:
        tissue: Probability of tissue, (h, w).
        layers: Position of the RPE.
        lit: Columns of `layers` in which the RPE is visible, those next to the shadow first.
        side: 1 if the shadow is to the left of them, -1 if to the right.
        scaling: From map to image.
    """
    near = lit[:SLOPE_COLUMNS]
    slope, start = np.polyfit(layers.x_px[near], layers.rpe_px[near], 1) if len(near) > 2 else (0.0, 0.0)
    start = start if len(near) > 2 else float(layers.rpe_px[near[0]])
    first = round((float(layers.x_px[near[0]]) + 0.5) / scaling.across - 0.5)
    columns = first - side * np.arange(-1, EDGE_COLUMNS)
    columns = columns[(columns >= 0) & (columns < tissue.shape[1])].astype(np.intp)
    rpe_px = start + slope * ((columns + 0.5) * scaling.across - 0.5)
    rows = np.rint(rpe_px / scaling.down).astype(np.intp) + np.arange(*RPE_ROWS)[:, None]
    inside = (rows[0] >= 0) & (rows[-1] < len(tissue))  # the RPE may leave the image before the shadow begins
    share = tissue[rows[:, inside], columns[inside]].mean(axis=0)
    dark = np.flatnonzero(share < HALF)
    if not inside.any() or not len(dark) or not dark[0]:
        return None
    last = int(dark[0])
    part = (share[last - 1] - HALF) / (share[last - 1] - share[last])
    return (float(columns[inside][last - 1] - side * part) + 0.5) * scaling.across - 0.5
