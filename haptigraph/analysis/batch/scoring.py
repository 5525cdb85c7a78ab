"""Score perception on a simulated recording, which contains the simulator's ground truth."""

import math
from typing import Any

from msgspec import Struct

from haptigraph.analysis.archive.about import state_of
from haptigraph.analysis.evaluation.report import Report, report_text
from haptigraph.analysis.evaluation.tip_scores import TipError, quantiles, spread, tip_error, tip_scores
from haptigraph.analysis.metrics.replay import (
    own_note,
    recorded_config,
    recorded_procedure,
    recorded_registration,
    replay_pipeline,
)
from haptigraph.assemble import perceiver_class, perceiver_name
from haptigraph.errors import BadInput
from haptigraph.geometry import Point
from haptigraph.importing import is_own
from haptigraph.inference.procedure import Procedure
from haptigraph.messages import Step, Truth
from haptigraph.projection import ImageGeometry
from haptigraph.recording.reader import RunReader
from haptigraph.recording.writer import Progress
from haptigraph.registration.camera import Registration

__all__ = ["report_recording", "score_recording"]

MIN_DEPTH_MM = 2.0
LARGEST, APART_S = 3, 0.5
"""How many of the largest errors are reported, and how far apart in time."""


class _Errors(Struct):
    """What was found in one recording, and its errors."""

    images: int = 0
    tips: int = 0
    false_tips: int = 0
    false_needles: int = 0
    tip_mm: list[float] = []
    tip_s: list[float] = []
    """When each was, since the first step."""
    along: list[TipError | None] = []
    theta_deg: list[float] = []
    theta_z: list[float] = []


def report_recording(reader: RunReader, procedure: Procedure, progress: Progress | None = None) -> Report:
    """Score perception on one recording with a procedure.

    Raises:
        BadInput: If it has no ground truth, or cannot be replayed.
    """
    perceiver, errors = _perceiver_of_needle(reader, procedure), _errors(reader, procedure, progress)
    scores = {
        "recording": str(reader.path),
        **({"recording_state": state} if (state := state_of(reader)) != "complete" else {}),
        "perceiver": perceiver,
        **({"note": own_note(reader, perceiver)} if is_own(perceiver) else {}),
        "scored_images": errors.images,
        "tips": errors.tips,
        "false_tips": errors.false_tips,
        "false_needles": errors.false_needles,
        "tip_error_mm": spread(errors.tip_mm),
        "theta_error_deg": spread(errors.theta_deg),
        "tip_z": tip_scores(errors.along)["tip_z"],
        "theta_z": quantiles(errors.theta_z),
        "largest_tip_errors_mm": _largest(errors),
    }
    return Report(scores, report_text(scores))


def score_recording(
    reader: RunReader, procedure: Procedure | None = None, progress: Progress | None = None
) -> dict[str, Any]:
    """Replay a recording, and compare the reported tips with the true ones.

    Args:
        reader: The recording.
        procedure: Another procedure to apply; None: the recorded one.
        progress: Called with the progress.

    Returns:
        the perceiver; images with a visible tip at least 2 mm inside; tips reported in them; tips reported
        with no instrument in the eye; errors of the tip [mm] and of theta [deg], image by image.

    Raises:
        BadInput: If it has no ground truth of a needle before a camera, or cannot be replayed.
    """
    perceiver, errors = _perceiver_of_needle(reader, procedure), _errors(reader, procedure, progress)
    return {
        "perceiver": perceiver,
        "images": errors.images,
        "tips": errors.tips,
        "false_tips": errors.false_tips,
        "tip_errors_mm": errors.tip_mm,
        "theta_errors_deg": errors.theta_deg,
    }


def _errors(reader: RunReader, procedure: Procedure | None, progress: Progress | None) -> _Errors:
    pipeline, errors = replay_pipeline(reader, procedure), _Errors()
    image = recorded_registration(reader).frontal.image
    steps = reader.count()[0] if progress is not None else 0
    first_ns, truths = None, 0
    for number, (capture, _) in enumerate(reader.records(), 1):
        step, truth = pipeline.step(capture), capture.truth
        first_ns = step.stamp_ns if first_ns is None else first_ns
        if progress is not None:
            progress("evaluating", number, steps)
        if truth is not None:
            truths += 1
            _add(errors, step, truth, image, (step.stamp_ns - first_ns) / 1e9)
    if not truths:
        raise BadInput(
            "has no ground truth, so perception cannot be scored; simulated runs have one", reader.path
        )
    return errors


def _add(errors: _Errors, step: Step, truth: Truth, image: ImageGeometry, time_s: float) -> None:
    """Add what was found in one image."""
    tip = step.observation.found.get("needle_tip")
    is_outside = not truth.visible and truth.depth_mm < 0
    errors.false_tips += isinstance(tip, Point) and is_outside
    errors.false_needles += is_outside and bool({"needle_tip", "needle_line"} & step.observation.found.keys())
    if not truth.visible or not truth.inside or truth.depth_mm < MIN_DEPTH_MM:
        return
    errors.images += 1
    errors.along.append(tip_error(step, image.to_px(truth.tip_mm), image))
    if isinstance(tip, Point):
        errors.tips += 1
        errors.tip_mm.append(round(math.dist(tip.at_mm, truth.tip_mm), 4))
        errors.tip_s.append(time_s)
    theta_deg, certainty = step.graph.measures.get("theta_deg"), step.observation.certainty
    if theta_deg is not None:
        errors.theta_deg.append(round(abs(theta_deg - truth.theta_deg), 4))
        if certainty is not None and certainty.theta_sd_deg > 0:
            errors.theta_z.append(errors.theta_deg[-1] / certainty.theta_sd_deg)


def _largest(errors: _Errors) -> dict[str, float]:
    """Return the largest errors of the tip by their time, neighbours left out."""
    largest = dict[float, float]()
    for error_mm, time_s in sorted(zip(errors.tip_mm, errors.tip_s, strict=True), reverse=True):
        if all(abs(time_s - other_s) >= APART_S for other_s in largest):
            largest[time_s] = error_mm
        if len(largest) == LARGEST:
            break
    return {f"at {time_s:.2f} s": error_mm for time_s, error_mm in largest.items()}


def _perceiver_of_needle(reader: RunReader, procedure: Procedure | None) -> str:
    """Return the perceiver's name, or refuse if no needle can be scored: 0 of 0 tips would look perfect."""
    if not isinstance(recorded_registration(reader), Registration):
        raise BadInput("shows B-scans or volumes; only needles before a camera are scored", reader.path)
    name = perceiver_name(recorded_config(reader), procedure or recorded_procedure(reader))
    if "needle_tip" not in perceiver_class(name).entities:
        raise BadInput(f"perceiver {name} reports no needle_tip, which alone is scored", reader.path)
    return name
