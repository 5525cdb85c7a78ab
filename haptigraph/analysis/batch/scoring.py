"""Score perception on a simulated recording, which contains the simulator's ground truth."""

import math
from typing import Any

from haptigraph.analysis.archive.about import state_of
from haptigraph.analysis.evaluation.evaluation import spread
from haptigraph.analysis.evaluation.report import Report, report_text
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
from haptigraph.recording.reader import RunReader
from haptigraph.recording.writer import Progress
from haptigraph.registration.camera import Registration

__all__ = ["report_recording", "score_recording"]

MIN_DEPTH_MM = 2.0


def report_recording(reader: RunReader, procedure: Procedure, progress: Progress | None = None) -> Report:
    """Score perception on one recording with a procedure; see `score_recording`.

    Raises:
        BadInput: If it has no ground truth, or cannot be replayed.
    """
    scores = score_recording(reader, procedure, progress)
    errors_mm, errors_deg = scores.pop("tip_errors_mm"), scores.pop("theta_errors_deg")
    perceiver = scores.pop("perceiver")
    scores = {
        "recording": str(reader.path),
        "perceiver": perceiver,
        **({"recording_state": state} if (state := state_of(reader)) != "complete" else {}),
        **({"note": own_note(reader, perceiver)} if is_own(perceiver) else {}),
        "scored_images": scores.pop("images"),
        **scores,
        "tip_error_mm": spread(errors_mm),
        "theta_error_deg": spread(errors_deg),
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
    pipeline = replay_pipeline(reader, procedure)
    perceiver = _perceiver_of_needle(reader, procedure)
    steps = reader.count()[0] if progress is not None else 0
    images = false_tips = tips = truths = 0
    errors_mm, errors_deg = list[float](), list[float]()
    for number, (capture, _) in enumerate(reader.records(), 1):
        step, truth = pipeline.step(capture), capture.truth
        if progress is not None:
            progress("evaluating", number, steps)
        if truth is None:
            continue
        truths += 1
        tip = step.observation.found.get("needle_tip")
        false_tips += isinstance(tip, Point) and not truth.visible and truth.depth_mm < 0
        if not truth.visible or not truth.inside or truth.depth_mm < MIN_DEPTH_MM:
            continue
        images += 1
        if isinstance(tip, Point):
            tips += 1
            errors_mm.append(round(math.dist(tip.at_mm, truth.tip_mm), 4))
        theta_deg = step.graph.measures.get("theta_deg")
        if theta_deg is not None:
            errors_deg.append(round(abs(theta_deg - truth.theta_deg), 4))
    if not truths:
        raise BadInput(
            "has no ground truth, so perception cannot be scored; simulated runs have one", reader.path
        )
    return {
        "perceiver": perceiver,
        "images": images,
        "tips": tips,
        "false_tips": false_tips,
        "tip_errors_mm": errors_mm,
        "theta_errors_deg": errors_deg,
    }


def _perceiver_of_needle(reader: RunReader, procedure: Procedure | None) -> str:
    """Return the perceiver's name, or refuse if no needle can be scored: 0 of 0 tips would look perfect."""
    if not isinstance(recorded_registration(reader), Registration):
        raise BadInput("shows B-scans or volumes; only needles before a camera are scored", reader.path)
    name = perceiver_name(recorded_config(reader), procedure or recorded_procedure(reader))
    if "needle_tip" not in perceiver_class(name).entities:
        raise BadInput(f"perceiver {name} reports no needle_tip, which alone is scored", reader.path)
    return name
