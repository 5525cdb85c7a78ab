"""The report of a trained network: docs/explanation/segmentation_report.md, a page with two figures."""

import argparse
import platform
from concurrent.futures import ProcessPoolExecutor
from importlib.metadata import version
from multiprocessing import get_context
from pathlib import Path
from typing import NamedTuple

import cv2
import matplotlib
import numpy as np

from haptigraph.messages import Image
from haptigraph.perception.oct.onnx_model import OnnxModel
from haptigraph.perception.oct.scan_geometry import Layers, Shaft
from haptigraph.perception.oct.segmentation import interpret
from haptigraph.sim.oct.bscan import CLASSES, Bscan
from training.profiles import KINDS
from training.score import SCORING_SEED, Scored, Totals, model_size_mb, score, totals
from training.without_needle import (
    DEEP_PX,
    EMPTY_SEED,
    MAX_SCAN_SHARE,
    EmptyScan,
    EmptyTotals,
    empty_totals,
    score_empty,
)

__all__ = ["TrainingRun", "write_report"]

DOCS = Path(__file__).parent.parent / "docs"
SCORED = 400
EXAMPLES = 8
PROCESSORS = 2
LIBRARIES = {"PyTorch": "torch", "NumPy": "numpy", "OpenCV": "opencv-python-headless"}
CPU_INFO = Path("/proc/cpuinfo")
EMPTY, EMPTY_KINDS = 500, {"healthy": False, "diseased": True}
ILM, RPE = (80, 220, 80), (80, 120, 255)
TRUE, OUTLINE = (255, 255, 255), (0, 0, 0)
NEEDLE = (60, 220, 255)
BAR_MM = 0.5


class TrainingRun(NamedTuple):
    """How a network was trained."""

    examples: int
    """Number of B-scans."""
    steps: int
    """Number of batches."""
    minutes: float
    """Duration of simulation and training."""
    busy_minutes: float
    """Processor time."""


def write_report(toml: Path, run: TrainingRun, folder: Path = DOCS) -> None:
    """Score a network and write its page and figures.

    Args:
        toml: TOML file of the network.
        run: How it was trained.
        folder: Of the docs: the page goes to its explanation/, figures to its images/.
    """
    with ProcessPoolExecutor(PROCESSORS, get_context("spawn")) as pool:
        with_needle = pool.submit(_scored, toml)
        without = {name: pool.submit(_scored_empty, toml, kind) for name, kind in EMPTY_KINDS.items()}
        scored, empty = with_needle.result(), {name: job.result() for name, job in without.items()}
    summed = totals(scored)
    for name in ("images", "explanation"):
        (folder / name).mkdir(parents=True, exist_ok=True)
    _draw_errors(summed, folder / "images" / "segmentation-errors.png")
    cv2.imwrite(str(folder / "images" / "segmentation-examples.jpg"), _draw_examples(scored))
    cv2.imwrite(str(folder / "images" / "segmentation-empty.jpg"), _draw_empty(empty, OnnxModel(str(toml))))
    page = _page(
        summed, {name: empty_totals(scans) for name, scans in empty.items()}, run, model_size_mb(toml)
    )
    (folder / "explanation" / "segmentation_report.md").write_text(page, encoding="utf-8")
    print(page, flush=True)


def _scored(toml: Path) -> list[Scored]:
    return list(score(OnnxModel(str(toml)), SCORED))


def _scored_empty(toml: Path, diseased: bool) -> list[EmptyScan]:
    return score_empty(OnnxModel(str(toml)), EMPTY, diseased=diseased)


def _page(summed: Totals, empty: dict[str, EmptyTotals], run: TrainingRun, size_mb: float) -> str:
    rows = "\n".join(
        f"| {name} | {np.median(np.abs(error)):.2f} | {np.percentile(np.abs(error), 95):.2f} | "
        f"{error.mean():+.2f} | {100 * summed.found_share[name]:.1f} % | "
        f"{100 * summed.false_share[name]:.1f} % |"
        for name, error in summed.errors_px.items()
    )
    needles = "\n".join(
        f"| {place} | {count} | {found} | {np.median(angles):.2f} / {np.percentile(angles, 95):.2f} deg | "
        f"{np.median(tips):.1f} / {np.percentile(tips, 95):.1f} px |"
        for place, (count, found, angles, tips) in summed.needles.items()
        if found
    )
    shares = summed.confusion / np.maximum(summed.confusion.sum(axis=1, keepdims=True), 1)
    confusion = "\n".join(
        f"| {name.replace('_', ', ')} | " + " | ".join(f"{100 * share:.1f} %" for share in row) + " |"
        for name, row in zip(CLASSES, shares, strict=True)
    )
    overlap = ", ".join(
        f"{name.replace('_', ' and ')} {value:.3f}"
        for name, value in zip(CLASSES, _overlaps(summed), strict=True)
    )
    empties = "\n".join(
        f"| {name} | {one.scans} | {one.needles} | {100 * one.deep_share:.2f} % | "
        f"{100 * one.worst_share:.1f} % | {one.scans_over} | {100 * one.found_share:.1f} % | "
        f"{one.rpe_px[0]:.2f} / {one.rpe_px[1]:.2f} px | {one.ilm_px[0]:.2f} / {one.ilm_px[1]:.2f} px |"
        for name, one in empty.items()
    )
    heads = " | ".join(name.replace("_", ", ") for name in CLASSES)
    return f"""# Evaluation of the shipped segmentation model

Written by `make train`; do not edit. How to use the model: [segmentation](segmentation.md).

A U-Net of {size_mb:.2f} MB, trained on {run.examples} simulated B-scans in {run.steps} batches of 8.
Simulation and training took {run.minutes:.0f} minutes on two processors of a shared machine,
{run.busy_minutes:.0f} of them processor time, with {_environment()}.
The same code, seeds and machine give the same network; another processor may give another.
A second network, trained on its errors in {sum(KINDS.values())} other B-scans, confirms the RPE.
No real B-scan was used. It is evaluated on {SCORED} other simulated
B-scans (seed {SCORING_SEED}) of 512 x 512 px with random retina, needle, noise, tilt,
shadows and artefacts. All errors are in pixels of the full image. The tip is the one that the perceiver
reports: the end of the needle class or, further along the shaft, the edge of its shadow.

## Surfaces

Absolute error in lit columns, at least four columns from the shadow's edge.

| | median px | p95 px | mean (signed) px | columns found | false columns in the shadow |
|---|---|---|---|---|---|
{rows}

![Errors of surfaces, angle and tip](../images/segmentation-errors.png)

## Needle

Angle and tip: median / p95. Without a needle, one was reported in {summed.false_needles} of
{summed.without_needle} B-scans.

| tip | B-scans | found | angle | tip |
|---|---|---|---|---|
{needles}

## Without needle

Other simulated B-scans without needle (seed {EMPTY_SEED}): detailed outer retina and choroid, several kinds
of devices, and lines that cast no shadow. The diseased ones have one to three of drusen, detachment of the
RPE, subretinal fluid, cysts and atrophy. *Too deep*: the share of columns in which the RPE was reported more
than {DEEP_PX} px below the true one, the unsafe direction. *Worst*: the largest share in one B-scan; *many*:
B-scans with more than {MAX_SCAN_SHARE:.0%}. Errors: median / p95, where the surface was reported.

| retina | B-scans | needles | RPE too deep | worst | many | RPE found | RPE error | ILM error |
|---|---|---|---|---|---|---|---|---|
{empties}

The first {EXAMPLES // 2} diseased B-scans, and the {EXAMPLES // 2} worst:

![B-scans without needle](../images/segmentation-empty.jpg)

## Confusion

Everything below the RPE is one class. Rows: true class; columns: predicted class. Intersection over
union: {overlap}.

| | {heads} |
|---|{"---|" * len(CLASSES)}
{confusion}

## Examples

White: ground truth. Green, red and yellow: detected ILM, RPE and needle. Top: the first {EXAMPLES // 2}
B-scans. Bottom: the {EXAMPLES // 4} worst surfaces, then the {EXAMPLES // 4} worst tips.

![Examples](../images/segmentation-examples.jpg)
"""


def _environment() -> str:
    """Return what a network depends on, besides code and seeds."""
    lines = CPU_INFO.read_text().splitlines() if CPU_INFO.is_file() else []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    processor = names[0] if names else platform.processor() or platform.machine()
    return ", ".join(f"{name} {version(package)}" for name, package in LIBRARIES.items()) + f" on {processor}"


def _overlaps(summed: Totals) -> list[float]:
    both = np.diag(summed.confusion)
    either = summed.confusion.sum(axis=0) + summed.confusion.sum(axis=1) - both
    return [float(share) for share in both / np.maximum(either, 1)]


def _draw_errors(summed: Totals, file: Path) -> None:
    matplotlib.use("Agg")
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(1, 3, figsize=(11, 3.2), constrained_layout=True)
    edges = np.linspace(0, 8, 81)
    for (name, error), color in zip(summed.errors_px.items(), ("#2a9d4a", "#d1495b"), strict=True):
        _cumulative(axes[0], np.abs(error), edges, name, color)
    for (place, (_, found, angles, tips)), color in zip(
        summed.needles.items(), ("#30638e", "#edae49", "#8d5a97"), strict=True
    ):
        if found:
            _cumulative(axes[1], angles, np.linspace(0, 2, 81), place, color)
            _cumulative(axes[2], tips, np.linspace(0, 30, 81), place, color)
    for axis, title, label in zip(
        axes, ("surfaces", "shaft angle", "tip"), ("error [px]", "error [deg]", "error [px]"), strict=True
    ):
        axis.set(
            title=title,
            xlabel=label,
            ylim=(0, 1),
            ylabel="share of B-scans" if axis is not axes[0] else "share of columns",
        )
        axis.grid(alpha=0.3)
        axis.legend(loc="lower right")
    figure.savefig(file, dpi=110)
    pyplot.close(figure)


def _cumulative(axis: "matplotlib.axes.Axes", errors: object, edges: object, label: str, color: str) -> None:
    values = np.sort(np.asarray(errors))
    axis.plot(
        edges, np.searchsorted(values, edges, side="right") / max(len(values), 1), label=label, color=color
    )


def _draw_examples(scored: list[Scored]) -> Image:
    surfaces = sorted(scored, key=lambda one: -one.worst_px)[: EXAMPLES // 4]
    tips = sorted(scored, key=lambda one: -np.nan_to_num(one.tip_error_px))[: EXAMPLES // 4]
    drawn = [_draw_one(one) for one in (*scored[: EXAMPLES // 2], *surfaces, *tips)]
    half = EXAMPLES // 2
    whole = np.vstack([np.hstack(drawn[:half]), np.hstack(drawn[half:])])
    return np.asarray(cv2.resize(whole, None, fx=0.7, fy=0.7, interpolation=cv2.INTER_AREA), np.uint8)


def _draw_empty(empty: dict[str, list[EmptyScan]], model: OnnxModel) -> Image:
    half = EXAMPLES // 2
    worst = sorted((scan for scans in empty.values() for scan in scans), key=lambda one: -one.deep_share)
    drawn = []
    for one in (*empty["diseased"][:half], *worst[:half]):
        scene = one.scene()
        scan = scene.take()
        scale_mm = scene.scan.lateral_mm_per_px, scene.scan.axial_mm_per_px
        found, shaft = interpret(model(scan.image), model, scan.image, scale_mm)
        canvas = _draw_surfaces(scan, found)
        _draw_needle(canvas, shaft)
        drawn.append(_titled(canvas, scale_mm, f"too deep in {one.deep_share:.1%} of columns"))
    whole = np.vstack([np.hstack(drawn[:half]), np.hstack(drawn[half:])])
    return np.asarray(cv2.resize(whole, None, fx=0.7, fy=0.7, interpolation=cv2.INTER_AREA), np.uint8)


def _draw_surfaces(scan: Bscan, found: Layers) -> Image:
    canvas = cv2.cvtColor(scan.image, cv2.COLOR_GRAY2BGR)
    truth, columns = scan.truth, np.arange(scan.image.shape[1])
    for row, lit in ((truth.ilm_px, truth.ilm_lit), (truth.rpe_px, truth.rpe_lit)):
        _dots(canvas, columns[lit][::6], row[lit][::6], TRUE)
    for row, visible, color in (
        (found.ilm_px, found.ilm_visible, ILM),
        (found.rpe_px, found.rpe_visible, RPE),
    ):
        _dots(canvas, np.rint(found.x_px[visible]), row[visible], color)
    return np.asarray(canvas, np.uint8)


def _draw_needle(canvas: Image, shaft: Shaft | None) -> None:
    if shaft is not None:
        ends = _rounded(shaft.start_px), _rounded(shaft.tip_px)
        cv2.line(canvas, *ends, NEEDLE, 1, cv2.LINE_AA)
        cv2.drawMarker(canvas, ends[1], NEEDLE, cv2.MARKER_CROSS, 12, 1)


def _titled(canvas: Image, scale_mm: tuple[float, float], text: str) -> Image:
    """Write a title, and draw bars of 0.5 mm across and along the beam."""
    right, bottom = canvas.shape[1] - 12, canvas.shape[0] - 40
    left, top = right - round(BAR_MM / scale_mm[0]), bottom - round(BAR_MM / scale_mm[1])
    font = cv2.FONT_HERSHEY_SIMPLEX
    (label_width, _), _ = cv2.getTextSize("0.5 mm", font, 0.5, 1)
    label_at = (min(left, right - label_width - 6), bottom - 6)
    for color, width_px in ((OUTLINE, 4), (TRUE, 1)):  # readable on bright tissue, too
        cv2.putText(canvas, text, (8, 500), font, 0.6, color, width_px, cv2.LINE_AA)
        cv2.putText(canvas, "0.5 mm", label_at, font, 0.5, color, width_px, cv2.LINE_AA)
        cv2.line(canvas, (left, bottom), (right, bottom), color, width_px + 1)
        cv2.line(canvas, (right, bottom), (right, top), color, width_px + 1)
    return canvas


def _draw_one(one: Scored) -> Image:
    canvas, truth = _draw_surfaces(one.scan, one.found), one.scan.truth
    if truth.needle is not None:
        cv2.circle(canvas, _rounded(truth.needle.tip_px), 8, TRUE, 1, cv2.LINE_AA)
    _draw_needle(canvas, one.shaft)
    return _titled(
        canvas, one.scale_mm, f"{one.place}, surfaces {one.worst_px:.1f} px, tip {one.tip_error_px:.1f} px"
    )


def _dots(canvas: object, columns: object, rows: object, color: tuple[int, int, int]) -> None:
    for x, y in zip(np.asarray(columns), np.rint(np.asarray(rows)).astype(int), strict=True):
        cv2.circle(canvas, (int(x), int(y)), 1, color, -1)


def _rounded(at_px: tuple[float, float]) -> tuple[int, int]:
    return round(at_px[0]), round(at_px[1])


def main() -> None:
    """Score a trained model again."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("toml", type=Path)
    parser.add_argument("--examples", type=int, required=True)
    parser.add_argument("--steps", type=int, required=True)
    parser.add_argument("--minutes", type=float, required=True)
    parser.add_argument("--busy-minutes", type=float, required=True)
    args = parser.parse_args()
    write_report(args.toml, TrainingRun(args.examples, args.steps, args.minutes, args.busy_minutes))


if __name__ == "__main__":
    main()
