"""The amplitude that a simulated participant associates with each angle after training.

Runs rules and haptics of the actual pipeline at every angle, half-way down, so that any procedure can be
learned.
"""

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from haptigraph import assemble
from haptigraph.config import Config, HapticsConfig
from haptigraph.geometry import Geometry, Point, Segment, rotate, subtract, unit
from haptigraph.messages import CERTAIN, Observation
from haptigraph.registration.camera import Registration
from haptigraph.registration.loading import parse_camera_registration
from haptigraph.sim.eye.eye import Eye, EyeShape, registration_text
from haptigraph.sim.eye.optics import CameraSettings, image_geometry
from haptigraph.study.simulated.ground_truth import GroundTruthPerceiver
from haptigraph.study.simulated.posterior import ANGLES_DEG

__all__ = ["trained_amplitudes"]

TRAINING_DEPTH_MM = 12.0


@lru_cache
def trained_amplitudes(
    procedure_text: str, max_amplitude: float, weakest_amplitude: float | None = None
) -> NDArray[np.float64]:
    """Return the haptic amplitude at each of `ANGLES_DEG`.

    Args:
        procedure_text: The text of the procedure.
        max_amplitude: The guard's limit.
        weakest_amplitude: Of the procedure's patterns, where a calibration sets it.
    """
    config = Config(haptics=HapticsConfig(weakest_amplitude=weakest_amplitude))
    procedure = assemble.parse_procedure(procedure_text, "the procedure of the training")
    eye, image = Eye(EyeShape()), CameraSettings()
    text = registration_text(eye, image_geometry(image), image.width_px, image.height_px)
    registration = parse_camera_registration(text, "the eye of the training")
    unused = GroundTruthPerceiver(registration, (0,))  # the observations are given
    pipeline = assemble.build_pipeline(config, registration, procedure, unused)
    amplitudes = []
    for number, theta_deg in enumerate(ANGLES_DEG):
        observation = Observation(
            number, _anatomy_with_needle(registration, float(theta_deg)), certainty=CERTAIN
        )
        pattern = pipeline.render(pipeline.reason(pipeline.build_scene(observation))).pattern
        amplitudes.append(0.0 if pattern.kind == "off" else pattern.amplitude)
        pipeline.reset()
    return np.minimum(amplitudes, max_amplitude)


def _anatomy_with_needle(registration: Registration, theta_deg: float) -> dict[str, Geometry]:
    trocar_mm, target_mm = registration.trocar.at_mm, registration.target.at_mm
    along = rotate(unit(subtract(target_mm, trocar_mm)), theta_deg)
    tip_mm = trocar_mm[0] + TRAINING_DEPTH_MM * along[0], trocar_mm[1] + TRAINING_DEPTH_MM * along[1]
    return registration.anatomy | {"needle_tip": Point(tip_mm), "needle_line": Segment(trocar_mm, tip_mm)}
