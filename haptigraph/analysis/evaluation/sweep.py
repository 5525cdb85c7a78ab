"""Score perceivers on many random simulated scenes: the same images for all, results per nuisance condition.

Errors of angle and tip are measured in the image, so that a registration error does not count against the
perceiver. States are compared only in scenes with a correct registration.
"""

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from msgspec import Struct, field
from msgspec.structs import replace

from haptigraph import assemble
from haptigraph.analysis.evaluation.angle_scores import angle_spreads
from haptigraph.analysis.evaluation.evaluation import Errors, errors_of, share
from haptigraph.analysis.evaluation.ground_truth import TruthRow
from haptigraph.analysis.evaluation.tip_scores import outside_scores, quantiles, spread, tip_scores
from haptigraph.config import Config
from haptigraph.geometry import Point, Segment, Vec, angle_between_deg, subtract
from haptigraph.inference.engine import RuleEngine, without_time
from haptigraph.inference.procedure import Procedure
from haptigraph.messages import CERTAIN, Capture, Observation, Step, Truth
from haptigraph.pipeline import Pipeline
from haptigraph.projection import ImageGeometry
from haptigraph.recording.writer import Progress
from haptigraph.registration.background import BackgroundImage
from haptigraph.registration.camera import Registration
from haptigraph.registration.loading import parse_camera_registration
from haptigraph.scene.builder import SchemaSceneBuilder
from haptigraph.sim.eye.distractors import Distractors
from haptigraph.sim.phantom import Moment, Phantom
from haptigraph.sim.scenario import Scenario
from haptigraph.sim.scenes import Scene
from haptigraph.sim.sweep_scenes import SWEEP_CONDITIONS, sweep_scene

__all__ = [
    "Sweep",
    "perceivers_to_compare",
    "play",
    "pooled",
    "registration_of",
    "shaft_error_deg",
    "sweep",
    "true_rows",
]

COMPARED = ("threshold", "tracker")
ALL = "all"


class Sweep(Struct, frozen=True):
    """The errors of perceivers on simulated scenes."""

    scenes: int
    seed: int
    errors: dict[str, dict[str, list[Errors]]] = field(default_factory=dict)
    """For each scene, by perceiver and nuisance condition."""

    def scores(self) -> dict[str, dict[str, dict[str, Any]]]:
        """Return scores by perceiver and nuisance condition, "all" first."""
        return {
            perceiver: {
                ALL: pooled([errors for scenes in by_condition.values() for errors in scenes]),
                **{name: pooled(scenes) for name, scenes in by_condition.items()},
            }
            for perceiver, by_condition in self.errors.items()
        }


def perceivers_to_compare() -> list[str]:
    """Return the perceivers that are compared by default, as far as they are available."""
    return [name for name in COMPARED if name in assemble.PERCEIVERS]


def sweep(
    scenes: int,
    perceivers: Sequence[str],
    config: Config,
    *,
    seed: int = 0,
    size_px: tuple[int, int] = (1280, 720),
    progress: Progress | None = None,
) -> Sweep:
    """Run perceivers on random scenes and compare their observations with the ground truth.

    Args:
        scenes: Number of scenes.
        perceivers: Their names.
        config: Their settings, and the procedure.
        seed: Seed of all scenes.
        size_px: Image size, (width, height), except where the condition is another resolution.
        progress: Called with the progress.
    """
    procedure = assemble.load_procedure(config.run.procedure)
    result = Sweep(scenes, seed)
    for perceiver in perceivers:
        result.errors[perceiver] = {name: [] for name in SWEEP_CONDITIONS[:scenes]}
    for number in range(scenes):
        if progress is not None:
            progress("playing scenes", number, scenes)
        scene = sweep_scene(number, seed, size_px=size_px)
        for perceiver, errors in _errors_of_scene(scene, perceivers, config, procedure).items():
            result.errors[perceiver][scene.nuisance].append(errors)
    if progress is not None:
        progress("playing scenes", scenes, scenes)
    return result


def pooled(scenes: Sequence[Errors]) -> dict[str, Any]:
    """Return the scores over all images of several scenes or clips."""
    angles_deg = [pair for errors in scenes for pair in errors.angles_deg]
    return {
        "scenes": len(scenes),
        "images": sum(errors.images for errors in scenes),
        "needle_images": sum(errors.needle_images for errors in scenes),
        "detection_rate": share([hit for errors in scenes for hit in errors.expected]),
        "false_detections": sum(errors.false_detections for errors in scenes),
        "tip_error_px": spread([error for errors in scenes for _, error in errors.tips_px]),
        "angle_error_deg": angle_spreads(angles_deg),
        "angle_z": quantiles([z for errors in scenes for z in errors.angle_z]),
        "state_agreement": share([hit for errors in scenes for hit in errors.agreed]),
        "wrong_contact_images": sum(errors.wrong_contact_images for errors in scenes),
        "contact_images": sum(errors.contact_images for errors in scenes),
        "missed_contact_images": sum(errors.missed_contact_images for errors in scenes),
        **tip_scores([tip for errors in scenes for tip in errors.tips]),
        **outside_scores([tip for errors in scenes for tip in errors.outside_tips]),
    }


def play(phantom: Phantom) -> Iterator[tuple[Capture, Moment]]:
    """Yield all captures and moments of a phantom from its beginning, raw (no JPEG)."""
    phantom.restart()
    for number in range(phantom.images):
        moment = phantom.advance()
        if moment is not None:
            yield Capture(number, round(moment.time_s * 1e9), moment.image), moment


def true_rows(truths: Sequence[Truth], registration: Registration, procedure: Procedure) -> list[TruthRow]:
    """Convert a simulator's ground truth to the rows of a labelled clip.

    Args:
        truths: One per image; without a needle_line the tip is on the shaft's axis.
        registration: The true anatomy.
        procedure: Its rules determine the states of the true needle.
    """
    build_scene, reason = SchemaSceneBuilder(procedure.schema), RuleEngine(without_time(procedure))
    rows = []
    for truth in truths:
        found = registration.anatomy | truth.others
        if truth.visible:
            found["needle_tip"] = Point(truth.tip_mm)
            found.setdefault("needle_line", Segment(registration.trocar.at_mm, truth.tip_mm))
        state = reason(build_scene(Observation(0, found, certainty=CERTAIN))).state
        rows.append(
            TruthRow(
                visible=truth.visible,
                inside=truth.inside,
                tip_px=truth.tip_px if truth.visible else None,
                depth_mm=truth.depth_mm if truth.visible else None,
                theta_deg=truth.theta_deg if truth.visible else None,
                state=state,
            )
        )
    return rows


def shaft_error_deg(step: Step, row: TruthRow, image: ImageGeometry, true_trocar_px: Vec) -> float | None:
    """Return the angle [deg] between the reported and the true shaft in the image; None if either is missing.

    Args:
        step: The step with the reported shaft.
        row: The ground truth.
        image: Geometry of the registration that the perceiver used.
        true_trocar_px: The true RCM.
    """
    line = step.observation.found.get("needle_line")
    if not isinstance(line, Segment) or row.tip_px is None:
        return None
    reported = subtract(image.to_px(line.end_mm), image.to_px(line.start_mm))
    true = subtract(row.tip_px, true_trocar_px)
    if row.depth_mm is not None and row.depth_mm < 0:
        true = -true[0], -true[1]
    return angle_between_deg(reported, true)


def _errors_of_scene(
    scene: Scene, perceivers: Sequence[str], config: Config, procedure: Procedure
) -> dict[str, Errors]:
    phantom = Phantom(scene.scenario)
    registration = registration_of(scene, phantom)
    pipelines = {
        name: assemble.build_pipeline(config.with_perceiver(name), registration, procedure)
        for name in perceivers
    }
    steps, truths = _steps(phantom, pipelines)
    true_registration = parse_camera_registration(phantom.true_registration, "the true registration")
    rows = true_rows(truths, true_registration, procedure)
    image, trocar_px = registration.image, phantom.camera.geometry.to_px(phantom.eye.trocar_mm)

    def angle_error_deg(step: Step, row: TruthRow) -> float | None:
        return shaft_error_deg(step, row, image, trocar_px)

    cannula_mm = scene.scenario.cannula.reach_mm if scene.scenario.cannula else 0.0
    errors = {
        name: errors_of(steps[name], rows, image, angle_error_deg, cannula_mm=cannula_mm)
        for name in perceivers
    }
    if scene.has_registration_error:
        return {
            name: replace(each, agreed=[], wrong_contact_images=0, contact_images=0, missed_contact_images=0)
            for name, each in errors.items()
        }
    return errors


def registration_of(scene: Scene, phantom: Phantom) -> Registration:
    """Return what was registered of a scene: its anatomy, and its image without instrument, if any."""
    registration = parse_camera_registration(phantom.registration, "the scene's registration")
    if scene.registered is None:
        return registration
    return replace(registration, background=_reference_image(scene.scenario, scene.registered))


def _reference_image(scenario: Scenario, registered: Distractors) -> BackgroundImage:
    """Take the image without instrument that was registered, with the distractors of that time."""
    away = replace(scenario.moves[0], away=True)
    captures = play(Phantom(replace(scenario, distractors=registered, moves=(away,))))
    image = next(moment.image for _, moment in captures)
    return BackgroundImage(image, np.ones(image.shape[:2], np.bool_))


def _steps(phantom: Phantom, pipelines: dict[str, Pipeline]) -> tuple[dict[str, list[Step]], list[Truth]]:
    steps: dict[str, list[Step]] = {name: [] for name in pipelines}
    truths = []
    for capture, moment in play(phantom):
        truths.append(moment.truth)
        for name, pipeline in pipelines.items():
            steps[name].append(pipeline.step(capture))
    return steps, truths
