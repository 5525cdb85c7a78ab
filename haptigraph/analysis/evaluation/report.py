"""What an evaluation came to: one object for other tools, tables for people."""

import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import msgspec
from msgspec import Struct

from haptigraph.analysis.evaluation.angle_noise import HeldDepth
from haptigraph.analysis.evaluation.evaluation import evaluate_clip
from haptigraph.analysis.evaluation.sweep import Sweep
from haptigraph.config import Config
from haptigraph.recording.writer import Progress

__all__ = ["Report", "report_clip", "sweep_object", "sweep_text"]

COLUMNS = (
    ("found >=2mm", 12),
    ("false", 6),
    ("tip px p50/p95", 15),
    ("1-3mm deg p50/p95", 18),
    (">3mm deg p50/p95", 17),
    ("state", 8),
    ("wrong contact", 14),
)
BOUNDS = ("inside", "inside_pivot_free", "both", "both_pivot_free")


class Report(Struct, frozen=True):
    """What an evaluation came to."""

    scores: dict[str, Any]
    """For other tools, as JSON can hold it."""
    text: str
    """For people."""


def report_clip(clip_dir: str | Path, config: Config, progress: Progress | None = None) -> Report:
    """Score a labelled clip.

    Raises:
        BadInput: If a file is missing or makes no sense.
    """
    evaluation = evaluate_clip(clip_dir, config, progress)
    lines = [f"{name:34}{value}" for name, value in _flat(evaluation.scores)]
    lag, perception = evaluation.lag_images, config.perception
    average = f" (alpha {perception.alpha:g})" if perception.perceiver == "threshold" else ""
    told = "-" if lag is None else f"{lag:.2f} images behind the truth{average}"
    return Report(evaluation.scores, "\n".join([*lines, f"{'lag':34}{told}"]))


def sweep_object(sweep: Sweep, held: Sequence[HeldDepth]) -> dict[str, Any]:
    """Return everything as one object that JSON can hold; an infinite bound is None."""
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
    """Return tables: scores by perceiver and difficulty, then the noise of the angle by depth."""
    return "\n".join([*_score_lines(sweep), "", *_noise_lines(sweep, held)])


def _score_lines(sweep: Sweep) -> Iterator[str]:
    for perceiver, rows in sweep.scores().items():
        head = "".join(f"{name:>{width}}" for name, width in COLUMNS)
        yield f"{perceiver:19}{'images':>7}{head}"
        for difficulty, scores in rows.items():
            angle = scores["angle_error_deg"]
            cells = (
                _percent(scores["detection_rate"]),
                str(scores["false_detections"]),
                _pair(scores["tip_error_px"]),
                _pair(angle["shallow"]),
                _pair(angle["deep"]),
                _percent(scores["state_agreement"]),
                str(scores["wrong_contact_images"]),
            )
            line = "".join(f"{cell:>{width}}" for cell, (_, width) in zip(cells, COLUMNS, strict=True))
            yield f"  {difficulty:17}{scores['images']:7}{line}"
        yield ""


def _noise_lines(sweep: Sweep, held: Sequence[HeldDepth]) -> Iterator[str]:
    names = list(sweep.errors)
    yield "noise of the angle [deg] of a needle held still, and the least possible (Cramer-Rao)"
    head = "".join(f"{name:>12}" for name in names) + "".join(
        f"{name.replace('_', ' '):>20}" for name in BOUNDS
    )
    yield f"{'depth':10}{head}"
    for each in held:
        noises = "".join(f"{_number(each.noise_deg[name]):>12}" for name in names)
        yield f"{each.depth_mm:4g} mm   {noises}" + "".join(
            f"{_number(bound):>20}" for bound in _bounds(each).values()
        )


def _bounds(held: HeldDepth) -> dict[str, float | None]:
    told = msgspec.structs.asdict(held.bound)
    return {name: told[f"{name}_deg"] if math.isfinite(told[f"{name}_deg"]) else None for name in BOUNDS}


def _pair(errors: dict[str, float | None]) -> str:
    return f"{_number(errors['median'])}/{_number(errors['p95'])}"


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.3g}"


def _percent(value: float | None) -> str:
    return "-" if value is None else f"{100 * value:.1f} %"


def _flat(scores: dict[str, Any], prefix: str = "") -> Iterator[tuple[str, str]]:
    """Turn nested scores into (name, value) lines."""
    for name, value in scores.items():
        if isinstance(value, dict):
            yield from _flat(value, f"{prefix}{name}.")
        else:
            yield f"{prefix}{name}", f"{value:.4g}" if isinstance(value, float) else str(value)
