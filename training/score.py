"""Score a network on simulated B-scans that were not used for training: confusion, surfaces, needle."""

from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from haptigraph.messages import Image
from haptigraph.perception.oct.onnx_model import OnnxModel
from haptigraph.perception.oct.scan_geometry import Layers, Shaft
from haptigraph.perception.oct.segmentation import interpret
from haptigraph.sim.oct.bscan import CLASSES, Bscan
from haptigraph.sim.oct.scenes import random_scene
from training.data import labels_of

__all__ = ["SCORING_SEED", "Scored", "Totals", "is_inside", "rows_by_column", "score", "totals"]

SCORING_SEED = 300
EDGE_PX = 4  # columns next to the shadow's soft edge, not scored

Floats = NDArray[np.float64]


class Scored(NamedTuple):
    """One B-scan, the detections in it and their errors, in pixels of the full image."""

    place: str
    scan: Bscan
    scale_mm: tuple[float, float]
    """Size of a pixel across and along the beam."""
    found: Layers
    shaft: Shaft | None
    confusion: NDArray[np.int64]
    """Counts of the network's pixels by (true, predicted) class."""
    errors_px: dict[str, Floats]
    """Detected less true row, by surface, where the tissue is lit; nan where it was not detected."""
    false_columns: dict[str, int]
    """Number of columns in the needle's shadow in which a surface was reported."""
    shadow_columns: dict[str, int]
    """Number of columns in the shadow."""
    angle_error_deg: float
    """nan without a true or a detected needle."""
    tip_error_px: float

    @property
    def worst_px(self) -> float:
        """95th percentile of the surfaces' absolute errors."""
        both = np.concatenate([np.abs(error) for error in self.errors_px.values()])
        return float(np.nanpercentile(both, 95)) if np.isfinite(both).any() else 0.0


def score(model: OnnxModel, count: int, seed: int = SCORING_SEED) -> Iterator[Scored]:
    """Yield `count` scored B-scans."""
    for number in range(count):
        scene = random_scene(number, seed)
        camera = scene.camera()
        scan = scene.take(camera)
        maps = model(scan.image)
        scale_mm = scene.scan.lateral_mm_per_px, scene.scan.axial_mm_per_px
        found, shaft = interpret(maps, model, scan.image, scale_mm)
        truth = scan.truth
        surfaces = {
            "ILM": (rows_by_column(found.x_px, found.ilm_px, found.ilm_visible), truth.ilm_px, truth.ilm_lit),
            "RPE": (rows_by_column(found.x_px, found.rpe_px, found.rpe_visible), truth.rpe_px, truth.rpe_lit),
        }
        angle, tip = _needle_errors(shaft, scan)
        yield Scored(
            place=scene.place,
            scan=scan,
            scale_mm=scale_mm,
            found=found,
            shaft=shaft,
            confusion=_confusion(labels_of(camera, truth), maps),
            errors_px={
                name: (row - true)[_eroded(lit) & is_inside(true)]
                for name, (row, true, lit) in surfaces.items()
            },
            false_columns={
                name: int(np.isfinite(row[_eroded(~lit)]).sum()) for name, (row, _, lit) in surfaces.items()
            },
            shadow_columns={name: int(_eroded(~lit).sum()) for name, (_, _, lit) in surfaces.items()},
            angle_error_deg=angle,
            tip_error_px=tip,
        )


def rows_by_column(x_px: Floats, row_px: Floats, is_seen: NDArray[np.bool_]) -> Floats:
    """Return the row in every column of the image; nan where the nearest column is not visible."""
    columns = np.arange(512)
    if not is_seen.any():
        return np.full(len(columns), np.nan)
    nearest = np.abs(x_px[:, None] - columns).argmin(axis=0)
    return np.where(is_seen[nearest], np.interp(columns, x_px[is_seen], row_px[is_seen]), np.nan)


def _eroded(is_column: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Exclude columns close to the border between lit and shadowed ones."""
    return cv2.erode(is_column.astype(np.uint8)[None], np.ones((1, 2 * EDGE_PX + 1), np.uint8))[0] > 0


def is_inside(row_px: Floats) -> NDArray[np.bool_]:
    """Return where a surface is inside the image, (w,)."""
    return (row_px > 8) & (row_px < 512 - 8)


def _confusion(true_classes: Image, maps: NDArray[np.float32]) -> NDArray[np.int64]:
    size = maps.shape[2], maps.shape[1]
    true = cv2.resize(true_classes, size, interpolation=cv2.INTER_NEAREST)
    pairs = true.astype(np.int64) * len(CLASSES) + maps.argmax(axis=0)
    return np.bincount(pairs.ravel(), minlength=len(CLASSES) ** 2).reshape(len(CLASSES), len(CLASSES))


def _needle_errors(found: Shaft | None, scan: Bscan) -> tuple[float, float]:
    true = scan.truth.needle
    if found is None or true is None:
        return np.nan, np.nan
    along = found.along_px
    angle = np.degrees(np.arctan2(along[1], along[0]) - np.arctan2(true.along_px[1], true.along_px[0]))
    return float((angle + 180) % 360 - 180), float(np.hypot(*np.subtract(found.tip_px, true.tip_px)))


class Totals(NamedTuple):
    """Scores of many B-scans."""

    confusion: NDArray[np.int64]
    errors_px: dict[str, Floats]
    found_share: dict[str, float]
    false_share: dict[str, float]
    needles: dict[str, tuple[int, int, Floats, Floats]]
    """By position of the tip: number, number detected, angle errors, tip errors."""
    false_needles: int
    without_needle: int


def totals(scored: list[Scored]) -> Totals:
    """Pool the scores."""
    errors = {name: np.concatenate([one.errors_px[name] for one in scored]) for name in scored[0].errors_px}
    needles = {}
    for place in ("above", "touching", "inside"):
        scored_here = [one for one in scored if one.place == place]
        reported = [one for one in scored_here if one.shaft is not None]
        needles[place] = (
            len(scored_here),
            len(reported),
            np.abs([one.angle_error_deg for one in reported]),
            np.array([one.tip_error_px for one in reported]),
        )
    without = [one for one in scored if one.scan.truth.needle is None]
    return Totals(
        confusion=np.sum([one.confusion for one in scored], axis=0),
        errors_px={name: error[np.isfinite(error)] for name, error in errors.items()},
        found_share={name: float(np.isfinite(error).mean()) for name, error in errors.items()},
        false_share={
            name: sum(one.false_columns[name] for one in scored)
            / max(sum(one.shadow_columns[name] for one in scored), 1)
            for name in errors
        },
        needles=needles,
        false_needles=sum(one.shaft is not None for one in without),
        without_needle=len(without),
    )


def model_size_mb(toml: Path) -> float:
    """Return the size of the network beside a TOML [MB]."""
    return toml.with_suffix(".onnx").stat().st_size / 1e6
