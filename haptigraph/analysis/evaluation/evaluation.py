"""Score perception and states against the ground truth of a labelled clip.

A clip is a folder with clip.mp4, registration.toml and truth.csv; docs/reference/conventions.md describes
them and defines every score.
"""

import math
from collections.abc import Sequence
from contextlib import closing
from pathlib import Path
from typing import Any

from msgspec import Struct
from msgspec.structs import replace

from haptigraph import assemble
from haptigraph.analysis.evaluation.angle_scores import (
    SHALLOW_MM,
    AngleError,
    angle_spreads,
    angle_z,
    theta_error_deg,
)
from haptigraph.analysis.evaluation.ground_truth import TruthRow, load_truth
from haptigraph.analysis.evaluation.tip_scores import (
    TipError,
    outside_scores,
    quantiles,
    spread,
    tip_error,
    tip_scores,
)
from haptigraph.clock import VirtualClock
from haptigraph.config import Config
from haptigraph.errors import BadInput
from haptigraph.geometry import Point, Vec
from haptigraph.messages import TIP_NOT_VISIBLE, UNKNOWN, Step
from haptigraph.projection import ImageGeometry
from haptigraph.recording.writer import Progress
from haptigraph.registration.loading import load_camera_registration
from haptigraph.sources.jpeg import JpegSource
from haptigraph.sources.reading import read_images

__all__ = [
    "Errors",
    "Evaluation",
    "errors_of",
    "evaluate_clip",
    "lag_images",
    "score",
    "share",
    "tip_mm",
]

CLIP_FILES = ("clip.mp4", "registration.toml", "truth.csv")
MIN_DEPTH_MM = 2.0
WALL_MM = 2.0  # a tip that disappears this close to the RCM is in the wall
CONTACT, HIT = "retinal_contact", "target_hit"
NOT_SILENT = {CONTACT, HIT, UNKNOWN, TIP_NOT_VISIBLE}


class Evaluation(Struct, frozen=True):
    """The scores of one clip."""

    scores: dict[str, Any]
    """As `score` returns them, preceded by "clip", "perceiver" and, if it is not empty, "assumed"."""
    lag_images: float | None
    """Lag of the reported tip behind the true one, in images."""


def evaluate_clip(
    folder: str | Path, config: Config, progress: Progress | None = None, *, as_recorded: bool = False
) -> Evaluation:
    """Run a labelled clip through a pipeline and score it.

    Args:
        folder: The clip.
        config: Selects perceiver and procedure.
        progress: Called with the progress.
        as_recorded: Whether images pass through JPEG first, as those of a camera do.

    Raises:
        BadInput: If a file is missing or not valid.
    """
    folder = Path(folder)
    _check_is_clip(folder)
    registration = load_camera_registration(folder / "registration.toml")
    registration.check_turn(config.source.turn, str(folder / "registration.toml"))
    procedure = assemble.load_procedure(config.run.procedure)
    truth = load_truth(folder / "truth.csv", [state.name for state in procedure.states])
    config = config.with_perceiver(assemble.perceiver_name(config, procedure))
    pipeline = assemble.build_pipeline(config, registration, procedure)
    clip = replace(config.source, uri=str(folder / "clip.mp4"), loop=False)
    source = assemble.open_source(replace(config, source=clip), VirtualClock())
    if as_recorded and clip.jpeg_quality:
        source = JpegSource(source, clip.jpeg_quality)
    steps = []
    try:
        with closing(read_images(source)) as captures:
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
    assumed = {"assumed": list(registration.assumed)} if registration.assumed else {}
    return Evaluation({**named, **assumed, **scores}, lag_images(steps, truth, registration.image))


def _check_is_clip(folder: Path) -> None:
    """Refuse a folder that is no labelled clip, and say what one holds."""
    missing = [name for name in CLIP_FILES if not (folder / name).is_file()]
    if missing:
        *others, last = missing
        names = f"{', '.join(others)} and {last} are" if others else f"{last} is"
        *held, end = CLIP_FILES
        holds = f"a labelled clip is a folder with {', '.join(held)} and {end}"
        raise BadInput(f"{names} missing; {holds}", folder)


class Errors(Struct, frozen=True):
    """Errors of one sequence of steps, image by image; sequences can be pooled."""

    images: int
    needle_images: int
    """Images in which the tip of a needle is visible."""
    expected: list[bool]
    """Whether a needle was detected, for images with at least 2 mm of needle inside."""
    false_detections: int
    tips_px: list[tuple[float, float]]
    """(depth [mm], error [px]) of tips detected inside."""
    angles_deg: list[tuple[float, float]]
    """(depth [mm], absolute error [deg]) of shafts detected inside."""
    angle_z: list[float]
    """These errors in reported standard deviations, where one is reported, at least 1 mm deep."""
    agreed: list[bool]
    """Whether the state agrees with the ground truth, for the images that count."""
    wrong_contact_images: int
    contact_images: int
    """Images of a contact that could be missed."""
    missed_contact_images: int
    tips: list[TipError | None]
    """Of images with at least 2 mm of needle inside; None if no tip was reported."""
    outside_tips: list[TipError | None]
    """Of images with a visible tip before the globe; the same."""


def errors_of(
    steps: Sequence[Step],
    truth: Sequence[TruthRow],
    image: ImageGeometry,
    angle_error_deg: AngleError = theta_error_deg,
    cannula_mm: float = 0.0,
) -> Errors:
    """Compare steps with the ground truth, image by image.

    Args:
        steps: What was reported.
        truth: The ground truth, one row per step.
        image: Geometry of the images.
        angle_error_deg: Compares an angle with its true value.
        cannula_mm: Length of the tube inside the eye that hides the tip like the wall; 0: there is none.
    """
    tips = [_tip_px(step, image) for step in steps]
    occluded = _occluded_by_wall(truth, WALL_MM + cannula_mm)
    states, true_states = [step.conclusion.state for step in steps], [row.state for row in truth]
    inside = [(row, number) for number, row in enumerate(truth) if row.visible and row.inside]
    tip_errors = [(row.depth_mm or 0.0, _distance(tips[number], row.tip_px)) for row, number in inside]
    angle_errors = [(_depth(row), angle_error_deg(steps[number], row)) for row, number in inside]
    at_depth = [number for row, number in inside if _depth(row) >= MIN_DEPTH_MM]
    deep = [(steps[number], truth[number]) for number in at_depth]
    contacts = [number for number in at_depth if _is_contact(true_states, number)]
    return Errors(
        images=len(truth),
        needle_images=sum(row.visible for row in truth),
        expected=[_is_needle_found(step) for step, _ in deep],
        false_detections=sum(
            _is_needle_found(step) and not row.visible and not row.inside and not in_wall
            for step, row, in_wall in zip(steps, truth, occluded, strict=True)
        ),
        tips_px=[(depth, error) for depth, error in tip_errors if error is not None],
        angles_deg=[(depth, error) for depth, error in angle_errors if error is not None],
        angle_z=[
            z
            for (depth, error), (_, number) in zip(angle_errors, inside, strict=True)
            if depth >= SHALLOW_MM[0] and (z := angle_z(steps[number], error)) is not None
        ],
        agreed=_agreement(states, true_states, occluded),
        wrong_contact_images=_wrong_contacts(states, true_states),
        contact_images=len(contacts),
        missed_contact_images=sum(states[number] not in NOT_SILENT for number in contacts),
        tips=[tip_error(step, row.tip_px, image) for step, row in deep],
        outside_tips=[
            tip_error(step, row.tip_px, image)
            for step, row in zip(steps, truth, strict=True)
            if row.visible and not row.inside
        ],
    )


def score(steps: Sequence[Step], truth: Sequence[TruthRow], image: ImageGeometry) -> dict[str, Any]:
    """Score steps against the ground truth, image by image.

    Returns:
        images, needle_images, detection_rate, false_detections, tip_error_px, tip_error_mm, angle_error_deg,
        angle_z, state_agreement, wrong_contact_images, contact_images, missed_contact_images, those of
        `tip_scores` and `outside_scores`, state_changes, final_state.
    """
    errors = errors_of(steps, truth, image)
    tips_px = [error for _, error in errors.tips_px]
    states, true_states = [step.conclusion.state for step in steps], [row.state for row in truth]
    return {
        "images": errors.images,
        "needle_images": errors.needle_images,
        "detection_rate": share(errors.expected),
        "false_detections": errors.false_detections,
        "tip_error_px": spread(tips_px),
        "tip_error_mm": spread([error * image.mm_per_px for error in tips_px]),
        "angle_error_deg": angle_spreads(errors.angles_deg),
        "angle_z": quantiles(errors.angle_z),
        "state_agreement": share(errors.agreed),
        "wrong_contact_images": errors.wrong_contact_images,
        "contact_images": errors.contact_images,
        "missed_contact_images": errors.missed_contact_images,
        **tip_scores(errors.tips),
        **outside_scores(errors.outside_tips),
        "state_changes": {"run": _changes(states), "truth": _changes(true_states)},
        "final_state": states[-1] if states else UNKNOWN,
    }


def share(hits: Sequence[bool]) -> float | None:
    """Return the share of hits; None if the sequence is empty."""
    return sum(hits) / len(hits) if hits else None


def lag_images(steps: Sequence[Step], truth: Sequence[TruthRow], image: ImageGeometry) -> float | None:
    """Estimate the lag of the reported tip in images by least squares of its error on the true motion."""
    projection, motion = 0.0, 0.0
    for row in range(1, len(truth)):
        before, now, tip = truth[row - 1].tip_px, truth[row].tip_px, _tip_px(steps[row], image)
        if before and now and tip and truth[row].inside:
            moved = now[0] - before[0], now[1] - before[1]
            projection -= (tip[0] - now[0]) * moved[0] + (tip[1] - now[1]) * moved[1]
            motion += moved[0] ** 2 + moved[1] ** 2
    return projection / motion if motion > 0 else None


def tip_mm(step: Step) -> Vec | None:
    """Return the reported tip, eye frame; None if there is none."""
    tip = step.observation.found.get("needle_tip")
    return tip.at_mm if isinstance(tip, Point) else None


def _tip_px(step: Step, image: ImageGeometry) -> Vec | None:
    tip = tip_mm(step)
    return image.to_px(tip) if tip is not None else None


def _depth(row: TruthRow) -> float:
    """Return the depth of a visible tip inside the eye; -inf for any other."""
    return row.depth_mm if row.visible and row.inside and row.depth_mm is not None else -math.inf


def _distance(tip: Vec | None, true_tip: Vec | None) -> float | None:
    return math.dist(tip, true_tip) if tip and true_tip else None


def _occluded_by_wall(truth: Sequence[TruthRow], wall_mm: float) -> list[bool]:
    """Mark images without a visible tip between images with the tip at the wall: it is passing through."""
    occluded = [False] * len(truth)
    row = 0
    while row < len(truth):
        end = row
        while end < len(truth) and not truth[end].visible:
            end += 1
        neighbours = [truth[other] for other in (row - 1, end) if 0 <= other < len(truth)]
        at_wall = any(abs(each.depth_mm) <= wall_mm for each in neighbours if each.depth_mm is not None)
        occluded[row:end] = [at_wall] * (end - row)
        row = end + 1
    return occluded


def _agreement(states: list[str], true_states: list[str], occluded: list[bool]) -> list[bool]:
    return [
        states[row] == true_states[row]
        for row in range(len(states))
        if not occluded[row] and len(set(true_states[max(row - 1, 0) : row + 2])) == 1
    ]


def _wrong_contacts(states: list[str], true_states: list[str]) -> int:
    return sum(
        state == CONTACT and not {CONTACT, HIT} & set(true_states[max(row - 1, 0) : row + 2])
        for row, state in enumerate(states)
    )


def _is_needle_found(step: Step) -> bool:
    """Return whether any part of a needle was reported."""
    return not {"needle_line", "needle_tip"}.isdisjoint(step.observation.found)


def _is_contact(true_states: list[str], row: int) -> bool:
    """Return whether the needle touches in an image, not within one image of a true change."""
    near = set(true_states[max(row - 1, 0) : row + 2])
    return len(near) == 1 and near <= {CONTACT, HIT}


def _changes(states: list[str]) -> int:
    return sum(states[row] != states[row - 1] for row in range(1, len(states)))
