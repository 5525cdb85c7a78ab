"""The report of an evaluation on volumes: one JSON object for other tools, a table for people."""

from pathlib import Path
from typing import Any

import numpy as np

from haptigraph.analysis.evaluation.report import Report
from haptigraph.analysis.evaluation.volumes import Residuals, VolumeEvaluation, evaluate_volumes
from haptigraph.perception.instrument.model import VoxelMm
from haptigraph.perception.instrument.rotations import Array
from haptigraph.recording.writer import Progress

__all__ = ["report_volumes", "volume_scores"]

GROSS_MM = 0.1
UM = 1e3


def report_volumes(folder: str | Path, voxel_mm: VoxelMm, progress: Progress | None = None) -> Report:
    """Score a folder of labelled volumes; see `evaluate_volumes`.

    Raises:
        BadInput: If a file is not valid, or the volumes are too few.
    """
    evaluation = evaluate_volumes(folder, voxel_mm, progress)
    return Report(volume_scores(evaluation), _text(evaluation))


def volume_scores(evaluation: VolumeEvaluation) -> dict[str, Any]:
    """Return the scores of an evaluation; a quantile of nothing is None."""
    gross = np.linalg.norm(evaluation.with_drift.tip_mm, axis=1) > GROSS_MM
    return {
        "volumes": evaluation.reported,
        "known_rate": evaluation.known / evaluation.reported,
        "gross_errors": int(gross.sum()),
        "without_drift": _scores(evaluation.without_drift),
        "with_drift": _scores(evaluation.with_drift),
    }


def _scores(residuals: Residuals) -> dict[str, Any]:
    z = np.abs(residuals.tip_mm / residuals.tip_sd_mm).ravel()
    return {
        "tip_residual_um": _median_p95(np.linalg.norm(residuals.tip_mm, axis=1) * UM),
        "tip_sd_axis_um": [float(sd) for sd in residuals.tip_mm.std(axis=0) * UM] if z.size else [None] * 3,
        "axis_residual_deg": _median_p95(residuals.axis_deg),
        "tip_z": {"p68": _quantile(z, 68), "p95": _quantile(z, 95), "p997": _quantile(z, 99.7)},
        "labelled_position_residual_um": _median_p95(np.linalg.norm(residuals.position_mm, axis=1) * UM),
    }


def _median_p95(values: Array) -> dict[str, float | None]:
    return {"median": _quantile(values, 50), "p95": _quantile(values, 95)}


def _quantile(values: Array, percent: float) -> float | None:
    return float(np.percentile(values, percent)) if values.size else None


def _text(evaluation: VolumeEvaluation) -> str:
    scores = volume_scores(evaluation)
    x, y, z = evaluation.offset_mm
    lines = [
        f"{evaluation.calibrated} volumes calibrated, {evaluation.reported} others reported on",
        f"pose known                 {scores['known_rate']:.1%}",
        f"tips over 100 µm off       {scores['gross_errors']}",
        f"{'':27}{'without drift':>20}{'with drift':>20}",
    ]
    parts = scores["without_drift"], scores["with_drift"]
    rows = (
        ("tip, µm: median / p95", "tip_residual_um", "{median:.1f} / {p95:.1f}"),
        ("axis, °: median / p95", "axis_residual_deg", "{median:.3f} / {p95:.3f}"),
        ("tip z: p68 / p95 / p997", "tip_z", "{p68:.2f} / {p95:.2f} / {p997:.2f}"),
        ("labelled position, µm", "labelled_position_residual_um", "{median:.1f} / {p95:.1f}"),
    )
    if evaluation.known:
        for title, key, form in rows:
            lines.append(f"{title:27}" + "".join(f"{form.format(**part[key]):>20}" for part in parts))
        sds = [" / ".join(f"{sd:.1f}" for sd in part["tip_sd_axis_um"]) for part in parts]
        lines.insert(5, f"{'sd along x / y / z, µm':27}" + "".join(f"{sd:>20}" for sd in sds))
    lines += [
        f"The tip is {np.linalg.norm(evaluation.offset_mm):.2f} mm from the labelled position, at "
        f"({x:.2f}, {y:.2f}, {z:.2f}) mm in the labelled frame.",
        f"The model was learned in {evaluation.learn_s:.0f} s; finding it takes a median of "
        f"{np.median(evaluation.find_ms):.1f} ms of processor time.",
    ]
    return "\n".join(lines)
