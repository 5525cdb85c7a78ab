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
from haptigraph.geometry import Vec
from haptigraph.imaging import FloatImage, Floats, Mask
from haptigraph.messages import Capture, Image, ImageKind, Observation
from haptigraph.perception.entities import ENTITIES
from haptigraph.perception.oct.class_edges import profiles, transmits_light, upper_edge
from haptigraph.perception.oct.class_maps import Rows, Scaling, border_rows, line_rows, without_neighbours
from haptigraph.perception.oct.class_needle import NeedleFit, fit_needles
from haptigraph.perception.oct.class_shadow import SHADOW_MARGIN_MM, Evidence, enters_from_border
from haptigraph.perception.oct.onnx_model import EntityClasses, ModelFile, OnnxModel, SurfaceClass
from haptigraph.perception.oct.scan_geometry import Layers, ObservationBuilder, Shaft
from haptigraph.perception.oct.surfaces import row_at, without_specks
from haptigraph.registration.oct import ScanRegistration

__all__ = ["SegmentationPerceiver", "interpret", "likely_layers"]

COLUMNS = 128  # largest number of columns in which surfaces are sampled
RPE_DEPTH_COST = 4.0  # an RPE that is reported too deep is the worse error
CERTAIN, DOUBTED = 0.001, 0.4  # probability, by the profiles of grey, that an RPE is too deep
EVEN = 0.15, 3.0  # probability, relative to its median in an image: least of nine in ten columns; largest
ILM_MARGIN_MM = (
    0.026  # nearer to the ILM than this, the needle may continue in tissue, where it is not visible
)
MIN_SHIFT_MM = 0.045  # nearer to the shadow's edge than this, the end of the needle's class is more precise
SLOPE_COLUMNS = 8  # used to extrapolate the RPE into the shadow
SEARCHED_MM = 0.37  # beyond the last visible RPE, for the shadow's edge
RPE_ABOVE_MM, RPE_BELOW_MM = 0.04, 0.02  # band in which tissue is looked for at the RPE
HALF = 0.5
MAX_DEPTH_MM = 0.73  # of the tip below the end of the needle's class
BEVEL_MM = 0.5  # largest distance of a tip above tissue beyond the end of the needle's class, across
HIDDEN_TIP_SD_MM, EDGE_SD_MM = (
    0.1,
    0.02,
)  # standard deviation of a tip that is not visible; at the shadow's edge


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
        scale = registration.image
        self._mm_per_px = scale.mm_per_px, scale.axial_mm_per_px or scale.mm_per_px

    def reset(self) -> None:
        """Do nothing: every image is processed independently."""

    def __call__(self, capture: Capture) -> Observation:
        """Process one image.

        Raises:
            BadInput: If it is not a B-scan of the registered size.
        """
        image = self._registration.checked(capture.image)
        layers, shaft = interpret(self._model(image), self._model, image, self._mm_per_px)
        return self._build_observation(capture.stamp_ns, layers, shaft)


def interpret(
    maps: FloatImage, network: OnnxModel, image: Image, mm_per_px: Vec
) -> tuple[Layers, Shaft | None]:
    """Extract surfaces and needle from a network's output, in pixels of the image.

    Args:
        maps: Probability of each class, (classes, h, w).
        network: The model that it comes from.
        image: The image, (h, w) or (h, w, 3).
        mm_per_px: Its lateral and axial scale.
    """
    _, height, width = maps.shape
    model = network.spec
    scaling = Scaling(image.shape[1] / width, image.shape[0] / height, *mm_per_px)
    ilm, rpe, likely = likely_layers(maps, model, scaling)
    rpe_px, is_rpe = likely.rpe_px, rpe.is_visible & (rpe.rows > ilm.rows)
    if model.entity.rpe is not None and model.entity.rpe.upper_edge:
        kept = image[:, : round(width // len(rpe_px) * len(rpe_px) * scaling.across)]
        rpe_px, is_first = upper_edge(kept, rpe_px, mm_per_px)
        is_undisputed = is_first & ~transmits_light(kept, rpe_px, mm_per_px)
        if model.entity.rpe.confirmed_by:
            too_deep = network.too_deep(profiles(kept, rpe_px, likely.rpe_visible, mm_per_px))
            is_rpe = _confirmed(too_deep, likely.rpe_visible, is_undisputed)
        else:
            is_rpe &= without_neighbours(is_undisputed)
    layers = likely._replace(
        ilm_visible=without_specks(ilm.is_visible), rpe_px=rpe_px, rpe_visible=without_specks(is_rpe)
    )
    return layers, _shaft(maps, model, image, likely, scaling)


def _confirmed(too_deep: Floats, is_likely: Mask, is_undisputed: Mask) -> Mask:
    """Return the columns, (n,), in which the second network confirms the RPE.

    Where it is certain, that suffices. If it is evenly uncertain and doubts no part of an image, noise causes
    that rather than a lesion. Then columns are confirmed, too, that are not doubted much more than others and
    that the image does not contradict.

    Args:
        too_deep: Probability that the RPE is too deep, (n,), as are the others.
        is_likely: Where there is one at all.
        is_undisputed: Where no other edge and no light below contradict it.
    """
    is_confirmed = without_neighbours(is_likely & (too_deep < CERTAIN))
    if is_likely.any():
        low, usual = np.percentile(too_deep[is_likely], (10, 50))
        if low > EVEN[0] * usual and too_deep[is_likely].max() < DOUBTED:
            is_confirmed |= without_neighbours(is_likely & is_undisputed & (too_deep < EVEN[1] * usual))
    return is_confirmed


def likely_layers(maps: FloatImage, model: ModelFile, scaling: Scaling) -> tuple[Rows, Rows, Layers]:
    """Return ILM and RPE in the maps, and both in pixels of the image wherever they are probable."""
    width = maps.shape[2]
    every = max(1, width // COLUMNS)
    columns = np.arange(width // every) * every + (every - 1) / 2
    entity, least_confidence = model.entity, model.least_confidence
    ilm, rpe = (
        _surface(maps, which, every, least_confidence, scaling.row_mm, cost)
        for which, cost in ((entity.ilm, 1.0), (entity.rpe, RPE_DEPTH_COST))
    )
    layers = Layers(
        x_px=(columns + 0.5) * scaling.across - 0.5,
        ilm_px=(ilm.rows + 0.5) * scaling.down - 0.5,
        ilm_visible=without_specks(ilm.is_likely),
        rpe_px=(rpe.rows + 0.5) * scaling.down - 0.5,
        rpe_visible=without_specks(rpe.is_likely & (rpe.rows > ilm.rows)),
    )
    return ilm, rpe, layers


def _surface(
    maps: FloatImage, which: SurfaceClass | None, every: int, threshold: float, row_mm: float, cost: float
) -> Rows:
    if which is None:
        count = maps.shape[2] // every
        return Rows(np.zeros(count), np.zeros(count, bool), np.zeros(count, bool))
    coarse = [_coarser(maps[index], every) for index in which.indices]
    if which.between:
        return border_rows(coarse[0], coarse[1], threshold, row_mm, cost)
    return line_rows(coarse[0], threshold)


def _coarser(values: FloatImage, every: int) -> FloatImage:
    """Average groups of `every` columns."""
    height, width = values.shape
    kept = values[:, : width // every * every]
    return np.asarray(cv2.resize(kept, (width // every, height), interpolation=cv2.INTER_AREA), np.float32)


def _shaft(
    maps: FloatImage, model: ModelFile, image: Image, layers: Layers, scaling: Scaling
) -> Shaft | None:
    """Return the needle: of the lines that enter from a border and cast a shadow, that with most evidence."""
    if model.entity.needle is None:
        return None
    needle = model.entity.needle
    fits = fit_needles(maps[needle.index], scaling, needle.least_confidence or model.least_confidence)
    size_px = image.shape[1], image.shape[0]
    fits = [fit for fit in fits if enters_from_border(fit.entry_px, fit.tip_px, size_px, scaling)]
    if not fits:
        return None
    tissue = _tissue(maps, model.entity)
    evidence = Evidence(image, tissue, scaling)
    for fit in fits:
        shaft = _with_tip(_as_shaft(fit), tissue, layers, scaling)
        if evidence.casts_shadow(shaft.start_px, shaft.tip_px):
            return shaft
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
    lateral_mm, axial_mm = scaling.lateral_mm, scaling.axial_mm
    slope, side = dy / max(abs(dx), 1e-3), math.copysign(1.0, dx)
    ahead_px = side * (layers.x_px - x)
    farthest_px = MAX_DEPTH_MM / axial_mm / max(slope, 1e-3)
    lit = np.flatnonzero(
        layers.rpe_visible & (ahead_px > -SHADOW_MARGIN_MM / lateral_mm) & (ahead_px < farthest_px)
    )
    ilm_y = row_at(layers.x_px, layers.ilm_px, layers.ilm_visible, x)
    edge_x = _shadow_edge(tissue, layers, lit if side > 0 else lit[::-1], side, scaling) if len(lit) else None
    if edge_x is None:
        is_observable = y < ilm_y - ILM_MARGIN_MM / axial_mm
        hidden_px = HIDDEN_TIP_SD_MM / lateral_mm
        return shaft if is_observable else shaft._replace(sd_px=(hidden_px, hidden_px * slope))
    further_px = side * (edge_x - x)
    is_inside = y + further_px * slope > ilm_y
    farthest_px = math.inf if is_inside else BEVEL_MM / lateral_mm
    if not MIN_SHIFT_MM / lateral_mm < further_px < farthest_px:
        return shaft
    edge_sd_px = EDGE_SD_MM / lateral_mm
    return shaft._replace(
        tip_px=(edge_x, y + further_px * slope),
        sd_px=(edge_sd_px, edge_sd_px * slope),
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
    columns = first - side * np.arange(-1, max(4, round(SEARCHED_MM / scaling.column_mm)))
    columns = columns[(columns >= 0) & (columns < tissue.shape[1])].astype(np.intp)
    rpe_px = start + slope * ((columns + 0.5) * scaling.across - 0.5)
    band = np.arange(
        -max(2, round(RPE_ABOVE_MM / scaling.row_mm)), max(1, round(RPE_BELOW_MM / scaling.row_mm))
    )
    rows = np.rint(rpe_px / scaling.down).astype(np.intp) + band[:, None]
    inside = (rows[0] >= 0) & (rows[-1] < len(tissue))  # the RPE may leave the image before the shadow begins
    share = tissue[rows[:, inside], columns[inside]].mean(axis=0)
    dark = np.flatnonzero(share < HALF)
    if not inside.any() or not len(dark) or not dark[0]:
        return None
    last = int(dark[0])
    part = (share[last - 1] - HALF) / (share[last - 1] - share[last])
    return (float(columns[inside][last - 1] - side * part) + 0.5) * scaling.across - 0.5
