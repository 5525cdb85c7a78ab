"""The perceiver `segmentation`: ILM, RPE and needle of a B-scan, as a neural network sees them.

Turns an image (px) into where things are (eye frame, mm), by the classes of a network of any origin. What
comes out is what the perceiver `bscan` gives, made by the same code. Knows nothing of states, and no image
before.
"""

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from haptigraph.config import PerceptionConfig
from haptigraph.imaging import FloatImage
from haptigraph.messages import Capture, Observation
from haptigraph.perception.oct.class_maps import Rows, Scaling, border_rows, line_rows
from haptigraph.perception.oct.class_needle import NeedleFit, fit_needles
from haptigraph.perception.oct.needle import row_at
from haptigraph.perception.oct.onnx_model import EntityClasses, ModelFile, OnnxModel, SurfaceClass
from haptigraph.perception.oct.scan_geometry import ENTITIES, Layers, ScanPlaces, Shaft, casts_shadow
from haptigraph.perception.oct.surfaces import without_specks
from haptigraph.registration.oct import ScanRegistration

__all__ = ["SegmentationPerceiver", "segments_of"]

COLUMNS = 128  # surfaces are looked at so finely, at most
NEAR_ILM_PX = 8.0  # a needle whose class ends no higher above the ILM may go on in tissue, unseen
MARGIN_PX = 14.0  # the class ends no further beyond the shadow's edge
LEAST_FURTHER_PX = 6.0  # so near to where the shadow begins, the end of the class says more
BEVEL_PX = 64.0  # above tissue, the tip lies at most so far beyond the class's end
SLOPE_COLUMNS, EDGE_COLUMNS = 8, 24  # that say how the RPE goes on into the shadow; that are looked at
RPE_ROWS = -6, 3  # of the map, about the RPE
HALF = 0.5
DEEPEST_PX = 220.0  # below that end the tip is not looked for
EDGE_DEVIATION_PX, UNSEEN_DEVIATION_PX = 2.5, 12.0  # of the shadow's edge; of a tip that nothing shows


class SegmentationPerceiver:
    """Find ILM, RPE and needle.

    Args:
        registration: Size and scale of the B-scans, and how deep the target lies.
        config: `model` names the network.

    Raises:
        MissingExtra: If ONNX Runtime is not installed.
        BadInput: If the network cannot be used.
    """

    needs_scan = True
    entities = ENTITIES

    def __init__(self, registration: ScanRegistration, config: PerceptionConfig) -> None:
        self._registration = registration
        self._model = OnnxModel(config.model)
        self._places = ScanPlaces(registration)

    def reset(self) -> None:
        """Forget earlier images: there is nothing to forget."""

    def __call__(self, capture: Capture) -> Observation:
        """Appearance at one image.

        Raises:
            BadInput: If it is no B-scan of the registered size.
        """
        image = self._registration.checked(capture.image)
        size_px = image.shape[1], image.shape[0]
        layers, shaft = segments_of(self._model(image), self._model.spec, size_px)
        return self._places(capture.stamp_ns, layers, shaft)


def segments_of(maps: FloatImage, model: ModelFile, size_px: tuple[int, int]) -> tuple[Layers, Shaft | None]:
    """Return what a network saw, in pixels of the image.

    Args:
        maps: Probability of each class, (classes, h, w).
        model: Says which class is what.
        size_px: (width, height) of the image.
    """
    _, height, width = maps.shape
    scaling = Scaling(size_px[0] / width, size_px[1] / height)
    every = max(1, width // COLUMNS)
    columns = np.arange(width // every) * every + (every - 1) / 2
    entity, least = model.entity, model.least_confidence
    ilm, rpe = (_surface(maps, which, every, least) for which in (entity.ilm, entity.rpe))
    layers = Layers(
        x_px=(columns + 0.5) * scaling.across - 0.5,
        ilm_px=(ilm.rows + 0.5) * scaling.down - 0.5,
        ilm_seen=without_specks(ilm.is_seen),
        rpe_px=(rpe.rows + 0.5) * scaling.down - 0.5,
        rpe_seen=without_specks(rpe.is_seen & (rpe.rows > ilm.rows)),
    )
    return layers, _shaft(maps, model, layers, scaling)


def _surface(maps: FloatImage, which: SurfaceClass | None, every: int, least: float) -> Rows:
    if which is None:
        count = maps.shape[2] // every
        return Rows(np.zeros(count), np.zeros(count, bool))
    coarse = [_coarser(maps[index], every) for index in which.indices]
    return border_rows(coarse[0], coarse[1], least) if which.between else line_rows(coarse[0], least)


def _coarser(values: FloatImage, every: int) -> FloatImage:
    """Return the means of so many columns each."""
    height, width = values.shape
    kept = values[:, : width // every * every]
    return np.asarray(cv2.resize(kept, (width // every, height), interpolation=cv2.INTER_AREA), np.float32)


def _shaft(maps: FloatImage, model: ModelFile, layers: Layers, scaling: Scaling) -> Shaft | None:
    """Return the needle: the line with most evidence that hides what a needle would hide."""
    if model.entity.needle is None:
        return None
    for fit in fit_needles(maps[model.entity.needle.index], scaling, model.least_confidence):
        shaft = _as_shaft(fit)
        if casts_shadow(shaft, layers):
            return _with_tip(shaft, _tissue(maps, model.entity), layers, scaling)
    return None


def _tissue(maps: FloatImage, entity: EntityClasses) -> FloatImage:
    """Return the probability of what only light can show at the RPE, (h, w)."""
    rpe, ilm = entity.rpe, entity.ilm
    shown = set() if rpe is None else set(rpe.indices)
    shown |= {ilm.between[1]} if ilm is not None and ilm.between else set()
    return np.asarray(sum((maps[index] for index in shown), np.zeros_like(maps[0])), np.float32)


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
    """Put the tip where the shadow begins, if that is beyond where metal is seen: in tissue it hardly is."""
    (x, y), (dx, dy) = shaft.tip_px, shaft.along_px
    slope, side = dy / max(abs(dx), 1e-3), math.copysign(1.0, dx)
    ahead_px = side * (layers.x_px - x)
    lit = np.flatnonzero(
        layers.rpe_seen & (ahead_px > -MARGIN_PX) & (ahead_px < DEEPEST_PX / max(slope, 1e-3))
    )
    ilm_y = row_at(layers.x_px, layers.ilm_px, layers.ilm_seen, x)
    edge_x = _shadow_edge(tissue, layers, lit if side > 0 else lit[::-1], side, scaling) if len(lit) else None
    if edge_x is None:
        is_told = y < ilm_y - NEAR_ILM_PX
        unseen_px = UNSEEN_DEVIATION_PX, UNSEEN_DEVIATION_PX * slope
        return shaft if is_told else shaft._replace(sd_px=unseen_px)
    further_px = side * (edge_x - x)
    is_inside = y + further_px * slope > ilm_y
    if not LEAST_FURTHER_PX < further_px < (math.inf if is_inside else BEVEL_PX):
        return shaft
    return shaft._replace(
        tip_px=(edge_x, y + further_px * slope),
        sd_px=(EDGE_DEVIATION_PX, EDGE_DEVIATION_PX * slope),
    )


def _shadow_edge(
    tissue: FloatImage, layers: Layers, lit: NDArray[np.intp], side: float, scaling: Scaling
) -> float | None:
    """Return the column where the needle's shadow begins [px of the image]; None if the image does not tell.

    Args:
        tissue: Its probability, (h, w).
        layers: Say where the RPE is.
        lit: Columns of `layers` that show it, those next to the shadow first.
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
    shown = (rows[0] >= 0) & (rows[-1] < len(tissue))  # the RPE may leave the image before the shadow begins
    share = tissue[rows[:, shown], columns[shown]].mean(axis=0)
    dark = np.flatnonzero(share < HALF)
    if not shown.any() or not len(dark) or not dark[0]:
        return None
    last = int(dark[0])
    part = (share[last - 1] - HALF) / (share[last - 1] - share[last])
    return (float(columns[shown][last - 1] - side * part) + 0.5) * scaling.across - 0.5
