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

COLUMNS = (
    ("found >=2mm", 12),  # detection rate at 2 mm depth or more
    ("false", 6),
    ("tip px p50/p95", 15),
    ("1-3mm deg p50/p95", 18),
    (">3mm deg p50/p95", 17),
    ("state", 8),
    ("wrong contact", 14),
    ("missed contact", 15),
    ("tip known", 10),
    ("tip far", 9),  # share of reported tips that are more than 0.3 mm off
    ("tip bias px", 12),
    ("tip z p68/p95/p997", 19),
)
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
        head = "".join(f"{name:>{width}}" for name, width in COLUMNS)
        yield f"{perceiver:19}{'images':>7}{head}"
        for condition, scores in rows.items():
            angle, has_needle = scores["angle_error_deg"], scores["needle_images"] > 0
            cells = (
                _percent(scores["detection_rate"]) if has_needle else "no needle",
                str(scores["false_detections"]),
                _pair(scores["tip_error_px"]),
                _pair(angle["shallow"]),
                _pair(angle["deep"]),
                _percent(scores["state_agreement"]) if has_needle else "n/a",
                str(scores["wrong_contact_images"]),
                str(scores["missed_contact_images"]) if has_needle else "n/a",
                _percent(scores["tip_known_rate"]),
                _percent(scores["tip_far_rate"]),
                _signed(scores["tip_bias_px"]),
                "/".join(_number(value) for value in scores["tip_z"].values()),
            )
            line = "".join(f"{cell:>{width}}" for cell, (_, width) in zip(cells, COLUMNS, strict=True))
            yield f"  {condition:17}{scores['images']:7}{line}"
        yield ""


def _noise_lines(sweep: Sweep, held: Sequence[HeldDepth]) -> Iterator[str]:
    names = list(sweep.errors)
    yield "angle noise [deg] of a stationary needle, and its Cramer-Rao bound"
    bounds = (name.removesuffix("_deg").replace("_", " ") for name in BOUNDS.values())
    head = "".join(f"{name:>12}" for name in names) + "".join(f"{name:>20}" for name in bounds)
    yield f"{'depth':10}{head}"
    for each in held:
        noises = "".join(f"{_number(each.noise_deg[name]):>12}" for name in names)
        yield f"{each.depth_mm:4g} mm   {noises}" + "".join(
            f"{_number(bound):>20}" for bound in _bounds(each).values()
        )


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
