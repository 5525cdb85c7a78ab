"""Score perception on a simulated recording, which contains the simulator's ground truth."""

import math
from pathlib import Path
from typing import Any

from haptigraph.analysis.metrics.replay import replay_pipeline
from haptigraph.errors import BadInput
from haptigraph.geometry import Point
from haptigraph.inference.procedure import Procedure
from haptigraph.recording.reader import RunReader

__all__ = ["score_recording"]

MIN_DEPTH_MM = 2.0


def score_recording(path: Path, procedure: Procedure | None = None) -> dict[str, Any]:
    """Replay a recording, and compare the reported tips with the true ones.

    Args:
        path: The recording.
        procedure: Another procedure to apply; None: the recorded one.

    Returns:
        images with a visible tip at least 2 mm inside; tips reported in them; tips reported with no
        instrument in the eye; errors of the tip [mm] and of theta [deg], image by image.

    Raises:
        BadInput: If it has no ground truth, or cannot be replayed.
    """
    reader = RunReader(path)
    pipeline = replay_pipeline(reader, procedure)
    images = false_tips = tips = truths = 0
    errors_mm, errors_deg = list[float](), list[float]()
    for capture, _ in reader.records():
        step, truth = pipeline.step(capture), capture.truth
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
        raise BadInput("has no ground truth, so perception cannot be scored; simulated runs have one", path)
    return {
        "images": images,
        "tips": tips,
        "false_tips": false_tips,
        "tip_errors_mm": errors_mm,
        "theta_errors_deg": errors_deg,
    }
