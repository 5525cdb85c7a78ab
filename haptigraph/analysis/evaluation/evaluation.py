"""Score perception and states against the truth of a labelled clip.

A clip is a folder with clip.mp4, registration.toml and truth.csv; docs/conventions.md describes them and
defines every figure. Knows the perceiver only by its steps.
"""

import math
from collections.abc import Callable, Sequence
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from haptigraph import assemble
from haptigraph.analysis.evaluation.ground_truth import TruthRow, load_truth
from haptigraph.clock import VirtualClock
from haptigraph.config import Config
from haptigraph.errors import BadInput
from haptigraph.geometry import ImageGeometry, Point, Vec
from haptigraph.messages import UNKNOWN, Step
from haptigraph.recording.writer import Progress
from haptigraph.registration.camera import load_registration
from haptigraph.sources.played import played

__all__ = [
    "Errors",
    "Evaluation",
    "angle_spreads",
    "errors_of",
    "evaluate_clip",
    "lag_images",
    "score",
    "share",
    "spread",
]

LEAST_DEPTH_MM = 2.0
SHALLOW_MM = (1.0, 3.0)
WALL_MM = 2.0  # a tip that vanishes this close to the pivot is in the wall
CONTACT, HIT = "retinal_contact", "target_hit"


class Evaluation(Struct, frozen=True):
    """The scores of one clip."""

    scores: dict[str, Any]
    """As `score` returns them, with "clip" and "perceiver" in front."""
    lag_images: float | None
    """How many images the reported tip lags behind the true one."""


def evaluate_clip(folder: str | Path, config: Config, progress: Progress | None = None) -> Evaluation:
    """Run a labelled clip through a pipeline and score it.

    Args:
        folder: The clip.
        config: Chooses perceiver and procedure.
        progress: Told how far it is.

    Raises:
        BadInput: If a file is missing or makes no sense.
    """
    folder = Path(folder)
    registration = load_registration(folder / "registration.toml")
    procedure = assemble.load_procedure(config.run.procedure)
    truth = load_truth(folder / "truth.csv", [state.name for state in procedure.states])
    config = config.with_perceiver(assemble.perceiver_name(config, procedure))
    pipeline = assemble.build_pipeline(config, registration, procedure)
    source = assemble.open_source(_with_source(config, folder / "clip.mp4"), VirtualClock())
    steps = []
    try:
        with closing(played(source)) as captures:
            for capture in captures:
                steps.append(pipeline.step(capture))
                if progress is not None:
                    progress("evaluating", len(steps), len(truth))
    except BadInput as error:
        raise BadInput(error.problem, error.file or folder / "clip.mp4", error.place) from None
    if len(steps) != len(truth):
        raise BadInput(f"has {len(truth)} rows, but the clip has {len(steps)} images", folder / "truth.csv")
    named = {"clip": folder.resolve().name, "perceiver": config.perception.perceiver}
    scores = score(steps, truth, registration.image)
    return Evaluation({**named, **scores}, lag_images(steps, truth, registration.image))


class Errors(Struct, frozen=True):
    """What one sequence of steps got right and wrong, image by image; to be pooled with others."""

    images: int
    expected: list[bool]
    """Found, of the images with at least 2 mm inside."""
    false_detections: int
    tips_px: list[tuple[float, float]]
    """(depth [mm], error [px]) of tips seen inside."""
    angles_deg: list[tuple[float, float]]
    """(depth [mm], absolute error [deg]) of shafts seen inside."""
    agreed: list[bool]
    """State as the truth has it, of the images that count."""
    wrong_contact_images: int


AngleError = Callable[[Step, TruthRow], float | None]
"""Absolute error of a step's angle [deg]; None if there is none."""


def _theta_error_deg(step: Step, row: TruthRow) -> float | None:
    """Return the absolute error of theta."""
    theta_deg = step.graph.measures.get("theta_deg")
    return None if theta_deg is None or row.theta_deg is None else abs(theta_deg - row.theta_deg)


def errors_of(
    steps: Sequence[Step],
    truth: Sequence[TruthRow],
    image: ImageGeometry,
    angle_error_deg: AngleError = _theta_error_deg,
) -> Errors:
    """Compare steps with the truth, image by image."""
    tips = [_tip_px(step, image) for step in steps]
    hidden = _hidden_in_wall(truth)
    states, true_states = [step.conclusion.state for step in steps], [row.state for row in truth]
    inside = [(row, number) for number, row in enumerate(truth) if row.visible and row.inside]
    misses = [(row.depth_mm or 0.0, _miss(tips[number], row.tip_px)) for row, number in inside]
    turns = [(_depth(row), angle_error_deg(steps[number], row)) for row, number in inside]
    return Errors(
        images=len(truth),
        expected=[tips[number] is not None for row, number in inside if _depth(row) >= LEAST_DEPTH_MM],
        false_detections=sum(
            tip is not None and not row.visible and not row.inside and not in_wall
            for tip, row, in_wall in zip(tips, truth, hidden, strict=True)
        ),
        tips_px=[(depth, error) for depth, error in misses if error is not None],
        angles_deg=[(depth, error) for depth, error in turns if error is not None],
        agreed=_agreed(states, true_states, hidden),
        wrong_contact_images=_wrong_contacts(states, true_states),
    )


def angle_spreads(angles_deg: Sequence[tuple[float, float]]) -> dict[str, dict[str, float | None]]:
    """Summarise (depth [mm], error [deg]) pairs, shallow and deep."""
    low, high = SHALLOW_MM
    return {
        "shallow": spread([error for depth, error in angles_deg if low <= depth <= high]),
        "deep": spread([error for depth, error in angles_deg if depth > high]),
    }


def score(steps: Sequence[Step], truth: Sequence[TruthRow], image: ImageGeometry) -> dict[str, Any]:
    """Score steps against the truth, image by image.

    Returns:
        detection_rate, false_detections, tip_error_px, tip_error_mm, angle_error_deg, state_agreement,
        wrong_contact_images, state_changes, final_state.
    """
    errors = errors_of(steps, truth, image)
    tips_px = [error for _, error in errors.tips_px]
    states, true_states = [step.conclusion.state for step in steps], [row.state for row in truth]
    return {
        "images": errors.images,
        "detection_rate": share(errors.expected),
        "false_detections": errors.false_detections,
        "tip_error_px": spread(tips_px),
        "tip_error_mm": spread([error * image.mm_per_px for error in tips_px]),
        "angle_error_deg": angle_spreads(errors.angles_deg),
        "state_agreement": share(errors.agreed),
        "wrong_contact_images": errors.wrong_contact_images,
        "state_changes": {"run": _changes(states), "truth": _changes(true_states)},
        "final_state": states[-1] if states else UNKNOWN,
    }


def share(hits: Sequence[bool]) -> float | None:
    """Return the share of hits; None of nothing."""
    return sum(hits) / len(hits) if hits else None


def spread(errors: Sequence[float]) -> dict[str, float | None]:
    """Return median and 95th percentile; None of nothing."""
    if not errors:
        return {"median": None, "p95": None}
    return {"median": float(np.median(errors)), "p95": float(np.percentile(errors, 95))}


def lag_images(steps: Sequence[Step], truth: Sequence[TruthRow], image: ImageGeometry) -> float | None:
    """Estimate the lag of the reported tip in images: least squares of its error on the true motion."""
    against, motion = 0.0, 0.0
    for row in range(1, len(truth)):
        before, now, tip = truth[row - 1].tip_px, truth[row].tip_px, _tip_px(steps[row], image)
        if before and now and tip and truth[row].inside:
            moved = now[0] - before[0], now[1] - before[1]
            against -= (tip[0] - now[0]) * moved[0] + (tip[1] - now[1]) * moved[1]
            motion += moved[0] ** 2 + moved[1] ** 2
    return against / motion if motion > 0 else None


def _with_source(config: Config, clip: Path) -> Config:
    return replace(config, source=replace(config.source, uri=str(clip), loop=False))


def _tip_px(step: Step, image: ImageGeometry) -> Vec | None:
    tip = step.observation.found.get("needle_tip")
    return image.to_px(tip.at_mm) if isinstance(tip, Point) else None


def _depth(row: TruthRow) -> float:
    """Return the depth of a visible tip inside the eye; -inf for any other."""
    return row.depth_mm if row.visible and row.inside and row.depth_mm is not None else -math.inf


def _miss(tip: Vec | None, true_tip: Vec | None) -> float | None:
    return math.dist(tip, true_tip) if tip and true_tip else None


def _hidden_in_wall(truth: Sequence[TruthRow]) -> list[bool]:
    """Mark unseen images whose neighbours in time show the tip at the wall: it is passing through."""
    hidden = [False] * len(truth)
    row = 0
    while row < len(truth):
        end = row
        while end < len(truth) and not truth[end].visible:
            end += 1
        beside = [truth[other] for other in (row - 1, end) if 0 <= other < len(truth)]
        at_wall = any(abs(seen.depth_mm) <= WALL_MM for seen in beside if seen.depth_mm is not None)
        hidden[row:end] = [at_wall] * (end - row)
        row = end + 1
    return hidden


def _agreed(states: list[str], true_states: list[str], hidden: list[bool]) -> list[bool]:
    return [
        states[row] == true_states[row]
        for row in range(len(states))
        if not hidden[row] and len(set(true_states[max(row - 1, 0) : row + 2])) == 1
    ]


def _wrong_contacts(states: list[str], true_states: list[str]) -> int:
    return sum(
        state == CONTACT and not {CONTACT, HIT} & set(true_states[max(row - 1, 0) : row + 2])
        for row, state in enumerate(states)
    )


def _changes(states: list[str]) -> int:
    return sum(states[row] != states[row - 1] for row in range(1, len(states)))
