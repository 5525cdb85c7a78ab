"""Score a network on simulated B-scans that nothing was learnt from: confusion, surfaces, needle."""

from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from haptigraph.messages import Image
from haptigraph.perception.oct.onnx_model import OnnxModel
from haptigraph.perception.oct.scan_geometry import Layers, Shaft
from haptigraph.perception.oct.segmentation import segments_of
from haptigraph.sim.oct.bscan import CLASSES, Bscan
from haptigraph.sim.oct.scenes import random_scene

__all__ = ["SCORING_SEED", "Scored", "Totals", "score", "totals"]

SCORING_SEED = 300
EDGE_PX = 4  # columns next to the shadow's edge, where half the light is missing, are not scored

Floats = NDArray[np.float64]


class Scored(NamedTuple):
    """One B-scan, what was found, and how wrong it was; pixels of the full image."""

    place: str
    scan: Bscan
    found: Layers
    shaft: Shaft | None
    confusion: NDArray[np.int64]
    """(true, found) counts of the network's pixels."""
    errors_px: dict[str, Floats]
    """Found less true row, by surface, where the tissue is lit; nan where nothing was found."""
    invented: dict[str, int]
    """Columns in the needle's shadow in which a surface was said to be seen."""
    shadowed: dict[str, int]
    """Columns in the shadow."""
    angle_error_deg: float
    """nan without a needle, true or found."""
    tip_error_px: float

    @property
    def worst_px(self) -> float:
        """The surfaces' largest error that is not the worst twentieth's."""
        both = np.concatenate([np.abs(error) for error in self.errors_px.values()])
        return float(np.nanpercentile(both, 95)) if np.isfinite(both).any() else 0.0


def score(model: OnnxModel, count: int, seed: int = SCORING_SEED) -> Iterator[Scored]:
    """Yield as many scored B-scans."""
    for number in range(count):
        scene = random_scene(number, seed)
        camera = scene.camera()
        scan = scene.take(camera)
        maps = model(scan.image)
        found, shaft = segments_of(maps, model.spec, (scan.image.shape[1], scan.image.shape[0]))
        truth = scan.truth
        surfaces = {
            "ILM": (_rows(found.x_px, found.ilm_px, found.ilm_seen), truth.ilm_px, truth.ilm_lit),
            "RPE": (_rows(found.x_px, found.rpe_px, found.rpe_seen), truth.rpe_px, truth.rpe_lit),
        }
        angle, tip = _needle_errors(shaft, scan)
        yield Scored(
            place=scene.place,
            scan=scan,
            found=found,
            shaft=shaft,
            confusion=_confusion(camera.classes(truth), maps),
            errors_px={
                name: (got - true)[_clear(lit) & _inside(true)] for name, (got, true, lit) in surfaces.items()
            },
            invented={
                name: int(np.isfinite(got[_clear(~lit)]).sum()) for name, (got, _, lit) in surfaces.items()
            },
            shadowed={name: int(_clear(~lit).sum()) for name, (_, _, lit) in surfaces.items()},
            angle_error_deg=angle,
            tip_error_px=tip,
        )


def _rows(x_px: Floats, row_px: Floats, is_seen: NDArray[np.bool_]) -> Floats:
    """Return the row at every column of the image; nan where the nearest place was not seen."""
    columns = np.arange(512)
    if not is_seen.any():
        return np.full(len(columns), np.nan)
    nearest = np.abs(x_px[:, None] - columns).argmin(axis=0)
    return np.where(is_seen[nearest], np.interp(columns, x_px[is_seen], row_px[is_seen]), np.nan)


def _clear(are: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return which columns are so far from where lit and shadowed ones meet."""
    return cv2.erode(are.astype(np.uint8)[None], np.ones((1, 2 * EDGE_PX + 1), np.uint8))[0] > 0


def _inside(row_px: Floats) -> NDArray[np.bool_]:
    return (row_px > 8) & (row_px < 512 - 8)


def _confusion(shown: Image, maps: NDArray[np.float32]) -> NDArray[np.int64]:
    size = maps.shape[2], maps.shape[1]
    true = cv2.resize(shown, size, interpolation=cv2.INTER_NEAREST)
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
    """Everything that a report says of many B-scans."""

    confusion: NDArray[np.int64]
    errors_px: dict[str, Floats]
    seen_share: dict[str, float]
    invented_share: dict[str, float]
    needles: dict[str, tuple[int, int, Floats, Floats]]
    """By place: how many, how many found, angle errors, tip errors."""
    false_needles: int
    without_needle: int


def totals(scored: list[Scored]) -> Totals:
    """Sum up."""
    errors = {name: np.concatenate([one.errors_px[name] for one in scored]) for name in scored[0].errors_px}
    needles = {}
    for place in ("above", "touching", "inside"):
        these = [one for one in scored if one.place == place]
        got = [one for one in these if one.shaft is not None]
        needles[place] = (
            len(these),
            len(got),
            np.abs([one.angle_error_deg for one in got]),
            np.array([one.tip_error_px for one in got]),
        )
    without = [one for one in scored if one.scan.truth.needle is None]
    return Totals(
        confusion=np.sum([one.confusion for one in scored], axis=0),
        errors_px={name: error[np.isfinite(error)] for name, error in errors.items()},
        seen_share={name: float(np.isfinite(error).mean()) for name, error in errors.items()},
        invented_share={
            name: sum(one.invented[name] for one in scored)
            / max(sum(one.shadowed[name] for one in scored), 1)
            for name in errors
        },
        needles=needles,
        false_needles=sum(one.shaft is not None for one in without),
        without_needle=len(without),
    )


def model_size_mb(toml: Path) -> float:
    """Return the size of the network beside a TOML [MB]."""
    return toml.with_suffix(".onnx").stat().st_size / 1e6
