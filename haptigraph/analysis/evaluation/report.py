"""The report of an evaluation: one JSON object for other tools, tables for people."""

import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from msgspec import Struct

from haptigraph.analysis.evaluation.angle_noise import HeldDepth
from haptigraph.analysis.evaluation.evaluation import evaluate_clip
from haptigraph.analysis.evaluation.sweep import Sweep
from haptigraph.config import Config
from haptigraph.recording.writer import Progress

__all__ = ["Report", "report_clip", "report_text", "sweep_object", "sweep_text"]

FOUND = (
    ("images", 7),
    ("found >=2mm", 12),  # detection rate at 2 mm depth or more
    ("false", 6),
    ("tip known", 10),
    ("tip far", 9),  # share of reported tips that are more than 0.3 mm off
    ("state", 8),
    ("wrong contact", 14),
    ("missed contact", 15),
)
ERRORS = (
    ("tip px p50/p95", 15),
    ("tip bias px", 12),
    ("tip z p68/p95/p997", 19),
    ("1-3mm deg p50/p95", 18),
    (">3mm deg p50/p95", 17),
)
"""Columns of the two tables of a perceiver, each at most 100 wide."""
BOUNDS = {
    "inside": "inside_deg",
    "inside_pivot_free": "inside_rcm_free_deg",
    "both": "both_deg",
    "both_pivot_free": "both_rcm_free_deg",
}
"""Fields of `AngleBound` by JSON key."""


class Report(Struct, frozen=True):
    """The result of an evaluation."""

    scores: dict[str, Any]
    """For other tools; can be encoded as JSON."""
    text: str
    """For people."""


def report_clip(
    clip_dir: str | Path, config: Config, progress: Progress | None = None, *, as_recorded: bool = False
) -> Report:
    """Score a labelled clip; see `evaluate_clip`.

    Raises:
        BadInput: If a file is missing or not valid.
    """
    evaluation = evaluate_clip(clip_dir, config, progress, as_recorded=as_recorded)
    lag, perception = evaluation.lag_images, config.perception
    average = f" (alpha {perception.alpha:g})" if perception.perceiver == "threshold" else ""
    lag_text = "-" if lag is None else f"{lag:.2f} images behind the truth{average}"
    return Report(evaluation.scores, f"{report_text(evaluation.scores)}\n{'lag':34}{lag_text}")


def report_text(scores: dict[str, Any]) -> str:
    """Return scores as text, one a line."""
    return "\n".join(f"{name:34}{value}" for name, value in _flat(scores))


def sweep_object(sweep: Sweep, held: Sequence[HeldDepth]) -> dict[str, Any]:
    """Return all results as one object that can be encoded as JSON; an infinite bound is None."""
    return {
        "scenes": sweep.scenes,
        "seed": sweep.seed,
        "perceivers": sweep.scores(),
        "angle_noise": [
            {"depth_mm": each.depth_mm, "noise_deg": each.noise_deg, "bound_deg": _bounds(each)}
            for each in held
        ],
    }


def sweep_text(sweep: Sweep, held: Sequence[HeldDepth]) -> str:
    """Return tables: scores by perceiver and nuisance condition, then the angle noise by depth."""
    return "\n".join([*_score_lines(sweep), "", *_noise_lines(sweep, held)])


def _score_lines(sweep: Sweep) -> Iterator[str]:
    for perceiver, rows in sweep.scores().items():
        for columns, cells_of in ((FOUND, _found_cells), (ERRORS, _error_cells)):
            yield f"{perceiver:19}{''.join(f'{name:>{width}}' for name, width in columns)}"
            for condition, scores in rows.items():
                cells = zip(cells_of(scores), columns, strict=True)
                yield f"  {condition:17}{''.join(f'{cell:>{width}}' for cell, (_, width) in cells)}"
            yield ""


def _found_cells(scores: dict[str, Any]) -> tuple[str, ...]:
    has_needle = scores["needle_images"] > 0
    return (
        str(scores["images"]),
        _percent(scores["detection_rate"]) if has_needle else "no needle",
        str(scores["false_detections"]),
        _percent(scores["tip_known_rate"]),
        _percent(scores["tip_far_rate"]),
        _percent(scores["state_agreement"]) if has_needle else "n/a",
        str(scores["wrong_contact_images"]),
        str(scores["missed_contact_images"]) if has_needle else "n/a",
    )


def _error_cells(scores: dict[str, Any]) -> tuple[str, ...]:
    return (
        _pair(scores["tip_error_px"]),
        _signed(scores["tip_bias_px"]),
        "/".join(_number(value) for value in scores["tip_z"].values()),
        _pair(scores["angle_error_deg"]["shallow"]),
        _pair(scores["angle_error_deg"]["deep"]),
    )


def _noise_lines(sweep: Sweep, held: Sequence[HeldDepth]) -> Iterator[str]:
    yield "angle noise [deg] of a stationary needle at its depths, and its Cramer-Rao bound"
    rows = {"depth": [f"{each.depth_mm:g} mm" for each in held]}
    rows |= {name: [_number(each.noise_deg[name]) for each in held] for name in sweep.errors}
    bounds = [_bounds(each) for each in held]
    for key, field in BOUNDS.items():
        name = f"bound {field.removesuffix('_deg').replace('_', ' ')}"
        rows[name] = [_number(each[key]) for each in bounds]
    for name, cells in rows.items():
        yield f"{name:27}{''.join(f'{cell:>9}' for cell in cells)}"


def _bounds(held: HeldDepth) -> dict[str, float | None]:
    values = {key: getattr(held.bound, field) for key, field in BOUNDS.items()}
    return {key: value if math.isfinite(value) else None for key, value in values.items()}


def _pair(errors: dict[str, float | None]) -> str:
    return f"{_number(errors['median'])}/{_number(errors['p95'])}"


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.3g}"


def _signed(value: float | None) -> str:
    return "-" if value is None else f"{value:+.2f}"


def _percent(value: float | None) -> str:
    return "-" if value is None else f"{100 * value:.1f} %"


def _flat(scores: dict[str, Any], prefix: str = "") -> Iterator[tuple[str, str]]:
    """Flatten nested scores into (name, value) pairs."""
    for name, value in scores.items():
        if isinstance(value, dict):
            yield from _flat(value, f"{prefix}{name}.")
        else:
            yield f"{prefix}{name}", f"{value:.4g}" if isinstance(value, float) else str(value)
