"""Measure the noise of the reported angle and tip: their standard deviations over images of one pose.

The images differ by noise alone: the needle enters and is held at a depth. The Cramer-Rao bound of the same
pose is the reference. There is no shadow, so that the bound concerns the shaft alone.
"""

import math
from collections.abc import Iterator, Sequence

import numpy as np
from msgspec import Struct

from haptigraph import assemble
from haptigraph.analysis.evaluation.cramer_rao import AngleBound, angle_bound
from haptigraph.analysis.evaluation.evaluation import tip_mm
from haptigraph.config import Config
from haptigraph.geometry import Segment, Vec, angle_between_deg
from haptigraph.messages import Capture, Step
from haptigraph.recording.writer import Progress
from haptigraph.registration.loading import parse_camera_registration
from haptigraph.sim.eye.camera import Camera
from haptigraph.sim.eye.eye import Eye, EyeShape, registration_text
from haptigraph.sim.eye.needle import NeedleShape
from haptigraph.sim.eye.optics import CameraSettings
from haptigraph.sim.eye.palette import Appearance
from haptigraph.sim.robot.robot import Pose, Robot, RobotLimits

__all__ = ["HeldDepth", "angle_noise"]

DEPTHS_MM = (1.0, 1.5, 2.0, 3.0, 5.0, 8.0, 12.0, 18.0)
THETA_DEG = 5.0
APPROACH_IMAGES, STEP_MM = 20, 0.3  # 9 mm/s at 30 images a second
SETTLING_IMAGES = 5
HELD_IMAGES = 100
NEAR_DEG, NEAR_MM = 2.0, 2.0
"""What is further from the truth is not a noisy sight of the needle: its spread would say nothing."""
NEEDLE = NeedleShape(diameter_mm=0.5, taper_mm=4.0)
PX_PER_MM_AT_720 = 20.0


class HeldDepth(Struct, frozen=True):
    """Noise at one held pose."""

    depth_mm: float
    noise_deg: dict[str, float | None]
    """Standard deviation of the reported angle by perceiver.

    None if under half of the images had one near the truth.
    """
    bound: AngleBound
    tip_noise_mm: dict[str, float | None]
    """Standard deviation of the reported tip by perceiver, in the worse of the two directions."""


def angle_noise(
    perceivers: Sequence[str],
    config: Config,
    *,
    seed: int = 0,
    depths_mm: Sequence[float] = DEPTHS_MM,
    size_px: tuple[int, int] = (1280, 720),
    progress: Progress | None = None,
) -> list[HeldDepth]:
    """Measure the noise of the reported angle at some depths.

    Args:
        perceivers: Their names; all process the same images.
        config: Their settings.
        seed: Seed of texture and noise.
        depths_mm: Depths at which the needle is held, measured from the RCM.
        size_px: Image size, (width, height).
        progress: Called with the progress.
    """
    eye, camera = _setup(seed, size_px)
    text = registration_text(eye, camera.geometry, *size_px)
    registration = parse_camera_registration(text, "the scene's registration")
    procedure = assemble.load_procedure(config.run.procedure)
    pipelines = {
        name: assemble.build_pipeline(config.with_perceiver(name), registration, procedure)
        for name in perceivers
    }
    held = []
    for number, depth_mm in enumerate(depths_mm):
        if progress is not None:
            progress("measuring noise", number, len(depths_mm))
        angles: dict[str, list[float | None]] = {name: [] for name in perceivers}
        tips: dict[str, list[Vec | None]] = {name: [] for name in perceivers}
        for pipeline in pipelines.values():
            pipeline.reset()
        held_at = Robot(eye.trocar_mm, RobotLimits(), _pose(eye, depth_mm))
        for capture in _captures(eye, camera, depth_mm, first=1000 * number):
            for name, pipeline in pipelines.items():
                step = pipeline.step(capture)
                angles[name].append(_angle_deg(step, held_at.direction()))
                tips[name].append(_near(tip_mm(step), held_at.tip_mm()))
        noise_deg = {name: _sd(reported[-HELD_IMAGES:]) for name, reported in angles.items()}
        tip_noise_mm = {name: _tip_sd(reported[-HELD_IMAGES:]) for name, reported in tips.items()}
        bound = angle_bound(camera, eye, _pose(eye, depth_mm))
        held.append(HeldDepth(depth_mm, noise_deg, bound, tip_noise_mm))
    if progress is not None:
        progress("measuring noise", len(depths_mm), len(depths_mm))
    return held


def _setup(seed: int, size_px: tuple[int, int]) -> tuple[Eye, Camera]:
    scale = size_px[1] / 720
    settings = CameraSettings(
        width_px=size_px[0],
        height_px=size_px[1],
        center_px=(size_px[0] / 2, 402 * scale),
        px_per_mm=PX_PER_MM_AT_720 * scale,
        shadow=0.0,
    )
    eye = Eye(EyeShape())
    return eye, Camera(eye, settings, NEEDLE, Appearance(), seed)


def _pose(eye: Eye, depth_mm: float) -> Pose:
    robot = Robot(eye.trocar_mm, RobotLimits(), Pose(0.0, 0.0))
    return Pose(depth_mm, robot.pitch_towards(eye.target_mm) + THETA_DEG)


def _captures(eye: Eye, camera: Camera, depth_mm: float, first: int) -> Iterator[Capture]:
    """Yield images of an approach and of the held pose; their numbers, from `first`, seed the noise."""
    for number in range(APPROACH_IMAGES + SETTLING_IMAGES + HELD_IMAGES):
        remaining = max(APPROACH_IMAGES - number, 0)
        robot = Robot(eye.trocar_mm, RobotLimits(), _pose(eye, depth_mm - STEP_MM * remaining))
        image = camera.render(robot.tip_mm(), robot.direction(), first + number)
        yield Capture(first + number, round((first + number) * 1e9 / 30), image)


def _angle_deg(step: Step, direction: Vec) -> float | None:
    """Return the angle of the reported line; None if there is none near the true direction."""
    line = step.observation.found.get("needle_line")
    if not isinstance(line, Segment):
        return None
    along = line.end_mm[0] - line.start_mm[0], line.end_mm[1] - line.start_mm[1]
    is_near = angle_between_deg(direction, along) <= NEAR_DEG
    return math.degrees(math.atan2(along[1], along[0])) if is_near else None


def _near(tip: Vec | None, true_mm: Vec) -> Vec | None:
    return tip if tip is not None and math.dist(tip, true_mm) <= NEAR_MM else None


def _tip_sd(tips_mm: Sequence[Vec | None]) -> float | None:
    both = [_sd([tip and tip[axis] for tip in tips_mm]) for axis in (0, 1)]
    return max((one for one in both if one is not None), default=None)


def _sd(values: Sequence[float | None]) -> float | None:
    found = [value for value in values if value is not None]
    return float(np.std(found, ddof=1)) if len(found) >= max(len(values) / 2, 2) else None
