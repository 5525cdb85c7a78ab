"""What training teaches a simulated participant: the amplitude that is felt at each angle, half-way down.

Turns rules and touch into that table, by the very stages that are used afterwards, so that any procedure can
be learned. Knows no person and no trial.
"""

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from haptigraph import assemble
from haptigraph.config import Config
from haptigraph.geometry import Geometry, Point, Segment, rotate, subtract, unit
from haptigraph.messages import Observation
from haptigraph.registration.camera import Registration
from haptigraph.registration.loading import parse_camera_registration
from haptigraph.sim.eye.eye import Eye, EyeShape, registration_text
from haptigraph.sim.eye.optics import CameraSettings, image_geometry
from haptigraph.study.simulated.belief import ANGLES_DEG
from haptigraph.study.simulated.ground_truth import GroundTruthPerceiver

__all__ = ["lesson"]

TRAINING_DEPTH_MM = 12.0


@lru_cache
def lesson(procedure_text: str, max_amplitude: float) -> NDArray[np.float64]:
    """Return the amplitude that is felt at each of `ANGLES_DEG`.

    Args:
        procedure_text: The procedure, whole.
        max_amplitude: The guard's limit.
    """
    config, procedure = Config(), assemble.parse_procedure(procedure_text, "the procedure of the training")
    eye, image = Eye(EyeShape()), CameraSettings()
    text = registration_text(eye, image_geometry(image), image.width_px, image.height_px)
    registration = parse_camera_registration(text, "the eye of the training")
    still = GroundTruthPerceiver(registration, (0,))  # never asked: the poses are given
    pipeline = assemble.build_pipeline(config, registration, procedure, still)
    amplitudes = []
    for number, theta_deg in enumerate(ANGLES_DEG):
        observation = Observation(number, _needle_at(registration, float(theta_deg)))
        pattern = pipeline.render(pipeline.reason(pipeline.build_scene(observation))).pattern
        amplitudes.append(0.0 if pattern.kind == "off" else pattern.amplitude)
        pipeline.reset()
    return np.minimum(amplitudes, max_amplitude)


def _needle_at(registration: Registration, theta_deg: float) -> dict[str, Geometry]:
    trocar_mm, target_mm = registration.trocar.at_mm, registration.target.at_mm
    along = rotate(unit(subtract(target_mm, trocar_mm)), theta_deg)
    tip_mm = trocar_mm[0] + TRAINING_DEPTH_MM * along[0], trocar_mm[1] + TRAINING_DEPTH_MM * along[1]
    return registration.anatomy | {"needle_tip": Point(tip_mm), "needle_line": Segment(trocar_mm, tip_mm)}
