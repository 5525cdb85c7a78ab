"""Random scenes for evaluating perception: short scenarios, each with its own nuisance condition.

A scene is an ordinary scenario: about 30 images in which the needle is away or outside, moves in, and holds.
The same number and seed give the same scene.
"""

import math

import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from haptigraph.geometry import Vec, norm, rotate, subtract, unit
from haptigraph.sim.eye.distractors import Distractors
from haptigraph.sim.eye.eye import Eye, EyeShape, RegistrationError
from haptigraph.sim.eye.needle import NeedleShape
from haptigraph.sim.eye.optics import CameraSettings
from haptigraph.sim.eye.palette import Appearance
from haptigraph.sim.robot.operator import Hand, Move
from haptigraph.sim.robot.robot import Pose, Robot, RobotLimits
from haptigraph.sim.scenario import About, Scenario

__all__ = ["NUISANCE_CONDITIONS", "Scene", "random_scene", "with_second_instrument"]

NUISANCE_CONDITIONS = (
    "plain",
    "noise",
    "blur",
    "glare",
    "shadow",
    "bubbles",
    "second_instrument",
    "flicker",
    "registration",
    "tilt",
    "mixture",
)
"""Nuisance conditions: "glare" is specular highlights, "mixture" three others but no registration error."""
POLARITIES = ("dark", "bright", "mixed")

GOLDEN = (math.sqrt(5) - 1) / 2  # its multiples fill the unit interval evenly for any number of scenes
DEPTH_MM = (1.0, 23.0)
APPROACH_MM = (5.0, 8.0)
MARGIN_MM = 0.2  # between the deepest tip and the retina
PIPE_CLEARANCE_MM = 1.5  # between the second instrument and the needle tip's final position
PEAK_RATIO = 1.875  # of a minimum-jerk move
SPEED_MM_S, TURN_DEG_S = 18.0, 27.0  # leaves room for tremor within the robot's 20 mm/s and 30 deg/s
WITHOUT_NEEDLE, LEAVING = 0.12, 0.12  # shares of the scenes
MAX_ERROR_PX = 3.0

Rng = np.random.Generator


class Scene(Struct, frozen=True):
    """One random scene."""

    nuisance: str
    polarity: str
    """Of the needle against the bowl: dark, bright, mixed (dark rims, bright middle), or crossing (the bowl
    is darker in one part and brighter in another)."""
    scenario: Scenario
    registered: Distractors | None = None
    """What the reference image in perception's registration shows beside the eye; None: it has none."""

    @property
    def has_registration_error(self) -> bool:
        """Whether perception receives a registration with errors."""
        return self.scenario.registration_error != RegistrationError()


class _Setting(Struct):
    """The parts of a scenario that a nuisance condition changes."""

    camera: CameraSettings
    needle: NeedleShape
    distractors: Distractors
    error: RegistrationError


def random_scene(number: int, seed: int = 0, *, size_px: tuple[int, int] = (1280, 720)) -> Scene:
    """Draw one scene.

    Args:
        number: Number of the scene; nuisance conditions cycle with it, and depths are spread evenly over it.
        seed: Seed of all scenes.
        size_px: (width, height) of the images; the eye scales with the height.
    """
    rng = np.random.default_rng((seed, 6, number))
    nuisance, polarity = (
        NUISANCE_CONDITIONS[number % len(NUISANCE_CONDITIONS)],
        POLARITIES[number % len(POLARITIES)],
    )
    shape = EyeShape(
        target_deg=rng.uniform(-15, 15), trocar_deg=float(rng.choice((-1, 1))) * rng.uniform(28, 42)
    )
    eye = Eye(shape)
    depth_share = (number * GOLDEN + np.random.default_rng((seed, 6)).uniform()) % 1
    moves, rest_mm = _moves(rng, eye, depth_share)
    setting = _Setting(
        _camera(rng, polarity, size_px), _needle(rng, polarity), Distractors(), RegistrationError()
    )
    for name in _mixture(rng) if nuisance == "mixture" else (nuisance,):
        _apply_nuisance(name, setting, rng, eye, rest_mm)
    scenario = Scenario(
        about=About(description=f"A random scene: {nuisance}.", seed=int(rng.integers(2**31))),
        moves=moves,
        eye=shape,
        camera=setting.camera,
        appearance=Appearance("light" if polarity == "dark" else "dark", texture=rng.uniform(0.5, 1.5)),
        needle=setting.needle,
        operator=Hand(tremor_rms_mm=rng.uniform(0.1, 0.4)),
        distractors=setting.distractors,
        registration_error=setting.error,
    )
    return Scene(nuisance, polarity, scenario)


def _mixture(rng: Rng) -> list[str]:
    single = [name for name in NUISANCE_CONDITIONS if name not in ("plain", "mixture", "registration")]
    return [str(name) for name in rng.choice(single, 3, replace=False)]


def _camera(rng: Rng, polarity: str, size_px: tuple[int, int]) -> CameraSettings:
    scale = size_px[1] / 720
    center = size_px[0] / 2 + scale * rng.uniform(-30, 30), size_px[1] / 2 + scale * rng.uniform(30, 55)
    return CameraSettings(
        width_px=size_px[0],
        height_px=size_px[1],
        center_px=center,
        px_per_mm=scale * rng.uniform(18, 21),
        mirrored=bool(rng.integers(2)),
        exposure={"dark": 1.0, "bright": 1.0, "mixed": 1.5}[polarity] * rng.uniform(0.85, 1.15),
        shadow=0.1,
        shadow_shift=(rng.uniform(-0.3, 0.3), rng.uniform(0.1, 0.35)),
    )


def _needle(rng: Rng, polarity: str) -> NeedleShape:
    shine = {"dark": (0.35, 0.48, 0.05), "bright": (0.75, 0.95, 0.05), "mixed": (0.08, 0.15, 0.6)}[polarity]
    return NeedleShape(
        diameter_mm=rng.uniform(0.3, 0.9),
        tip_diameter_mm=rng.uniform(0.1, 0.2),
        taper_mm=rng.uniform(1.5, 9.0),
        brightness=rng.uniform(*shine[:2]),
        highlight=shine[2],
    )


def _moves(rng: Rng, eye: Eye, depth_share: float) -> tuple[tuple[Move, ...], Vec]:
    """Return the script and the tip's final position [mm]."""
    robot = Robot(eye.trocar_mm, RobotLimits(), Pose(0.0, 0.0))
    axis_deg = robot.pitch_towards(eye.target_mm)
    theta_deg = float(np.clip(rng.uniform(-12, 12), -45 - axis_deg, 45 - axis_deg))
    inwards = unit(subtract((0.0, 0.0), eye.trocar_mm))
    along = rotate(inwards, axis_deg + theta_deg)
    # More shallow scenes than deep ones, because a short visible shaft makes the angle hard to estimate.
    drawn_mm = DEPTH_MM[0] + (DEPTH_MM[1] - DEPTH_MM[0]) * depth_share**1.5
    depth_mm = min(drawn_mm, _chord_mm(eye.trocar_mm, along, eye.radius_mm) - MARGIN_MM)
    start_mm = max(depth_mm - rng.uniform(*APPROACH_MM), rng.uniform(-4.0, -2.0))
    turn_deg = rng.uniform(-8, 8)
    turn_deg = float(np.clip(theta_deg + turn_deg, -45 - axis_deg, 45 - axis_deg)) - theta_deg
    needed_s = PEAK_RATIO * max((depth_mm - start_mm) / SPEED_MM_S, abs(turn_deg) / TURN_DEG_S)
    start = Move(0.1, start_mm, theta_deg + turn_deg, away=bool(start_mm > -1 or rng.random() < 0.5))
    rest = Move(needed_s + 0.03, depth_mm, theta_deg)
    moves = [start, rest, replace(rest, duration_s=0.2)]
    outcome = rng.random()
    if outcome < WITHOUT_NEEDLE:
        moves = [replace(start, duration_s=0.8, away=True)]
    elif outcome < WITHOUT_NEEDLE + LEAVING:
        moves.append(replace(rest, duration_s=0.17, away=True))
    x, y = eye.trocar_mm
    return tuple(moves), (x + depth_mm * along[0], y + depth_mm * along[1])


def _chord_mm(start_mm: Vec, along: Vec, radius_mm: float) -> float:
    """Return the distance along a line from a point outside a circle to the circle's far side."""
    middle = -(start_mm[0] * along[0] + start_mm[1] * along[1])
    miss_squared = norm(start_mm) ** 2 - middle**2
    return middle + math.sqrt(max(radius_mm**2 - miss_squared, 0.0))


def _apply_nuisance(name: str, setting: _Setting, rng: Rng, eye: Eye, rest_mm: Vec) -> None:
    """Apply one nuisance condition to a setting, in place."""
    camera, needle, others = setting.camera, setting.needle, setting.distractors
    if name == "noise":
        factor = rng.uniform(2, 3)
        setting.camera = replace(camera, read_noise_grey=1.5 * factor, shot_noise_grey=2.5 * factor)
    elif name == "blur":
        setting.camera = replace(camera, blur_px=rng.uniform(1.5, 2.5))
    elif name == "glare":
        setting.distractors = replace(others, specular_highlights=int(rng.integers(6, 15)))
        setting.needle = replace(needle, highlight=needle.highlight + rng.uniform(0.3, 0.6))
    elif name == "shadow":
        setting.camera = replace(camera, shadow=rng.uniform(0.3, 0.5))
    elif name == "bubbles":
        setting.distractors = replace(
            others, bubbles=int(rng.integers(4, 10)), bubble_mm=rng.uniform(0.4, 1.2)
        )
    elif name == "second_instrument":
        setting.distractors = with_second_instrument(others, rng, eye, rest_mm)
    elif name == "flicker":
        setting.distractors = replace(others, flicker=rng.uniform(0.05, 0.15))
    elif name == "registration":
        setting.error = _registration_error(rng, camera.height_px / 720)
    elif name == "tilt":
        setting.needle = replace(needle, tilt_deg=rng.uniform(15, 45))


def with_second_instrument(others: Distractors, rng: Rng, eye: Eye, rest_mm: Vec) -> Distractors:
    """Add a second instrument that may cross the needle, but not near its tip's final position [mm]."""
    brightness = rng.uniform(0.2, 0.8)
    pipe = replace(others.light_pipe, brightness=brightness, diameter_mm=rng.uniform(0.5, 0.9))
    while True:
        depth_mm, pitch_deg = rng.uniform(4, 14), rng.uniform(-35, 35)
        _, along = eye.second_instrument(depth_mm, pitch_deg)
        offset = subtract(rest_mm, eye.other_trocar_mm)
        at = min(max(offset[0] * along[0] + offset[1] * along[1], 0), depth_mm)
        if norm(subtract(offset, (at * along[0], at * along[1]))) > PIPE_CLEARANCE_MM:
            return replace(others, light_pipe_mm=depth_mm, light_pipe_deg=pitch_deg, light_pipe=pipe)


def _registration_error(rng: Rng, scale: float) -> RegistrationError:
    def shift() -> Vec:
        turn, reach = rng.uniform(0, 2 * math.pi), MAX_ERROR_PX * scale * math.sqrt(rng.uniform(0.1, 1))
        return reach * math.cos(turn), reach * math.sin(turn)

    return RegistrationError(shift(), shift(), shift())
