"""The scenes of `haptigraph evaluate --simulated`: those of `random_scene`, and six conditions more.

The added conditions change scenes with the condition "plain" and draw from a stream of their own. So the
other scenes are the same as without them, and their scores stay comparable.
"""

import numpy as np
from msgspec.structs import replace

from haptigraph.geometry import Vec, rotate, subtract, unit
from haptigraph.sim.eye.cannula import CannulaShape, is_in_cannula
from haptigraph.sim.eye.distractors import Distractors
from haptigraph.sim.eye.eye import Eye
from haptigraph.sim.eye.palette import Appearance
from haptigraph.sim.scenario import Scenario
from haptigraph.sim.scenes import NUISANCE_CONDITIONS, Scene, random_scene, with_second_instrument

__all__ = ["ADDED_CONDITIONS", "SWEEP_CONDITIONS", "sweep_scene"]

ADDED_CONDITIONS = (
    "low_resolution",
    "high_resolution",
    "motion_blur",
    "color_crossing",
    "cannula",
    "clutter",
)
SWEEP_CONDITIONS = (*NUISANCE_CONDITIONS, *ADDED_CONDITIONS)
"""All conditions, in the order in which the scenes of a sweep cycle through them."""
RESOLUTIONS = {"low_resolution": 0.5, "high_resolution": 1.5}
SHUTTER_S = (0.012, 0.025)  # 9 px at 18 mm/s and 20 px/mm
SHAKE_PX = (3.0, 9.0)
BROWN_BGR = (52.0, 100.0, 150.0)
BROWN_TOP_SHADE, BROWN_BOTTOM_SHADE = 0.5, 1.06  # the lower one is the same for all bowls
CROSSING_AT = (0.25, 0.6)  # where the bowl is as bright as the needle, from its top to its bottom
MEAN_TONE = 0.94  # of a cylinder's brightness, across it
REACH_MM, CLEARANCE_MM = (1.0, 2.5), (0.15, 0.35)  # of a cannula: into the eye; wider than the needle
BEYOND_CANNULA_MM = 1.0  # the needle comes to rest at least this far out of it

Rng = np.random.Generator


def sweep_scene(number: int, seed: int = 0, *, size_px: tuple[int, int] = (1280, 720)) -> Scene:
    """Draw one scene of a sweep.

    Args:
        number: Number of the scene; conditions cycle with it.
        seed: Seed of all scenes.
        size_px: (width, height) of the images, except where the condition is another resolution.
    """
    cycle, place = divmod(number, len(SWEEP_CONDITIONS))
    if place < len(NUISANCE_CONDITIONS):
        return random_scene(cycle * len(NUISANCE_CONDITIONS) + place, seed, size_px=size_px)
    name = SWEEP_CONDITIONS[place]
    # One more per cycle than there are conditions, so that each meets needles of all polarities.
    plain = cycle * (len(ADDED_CONDITIONS) + 1) + place - len(NUISANCE_CONDITIONS)
    rng = np.random.default_rng((seed, 14, number))
    if name in RESOLUTIONS:
        scene = _scaled(plain, seed, size_px, RESOLUTIONS[name])
    elif name == "cannula":
        scene = _with_cannula(plain, seed, size_px, rng)
    else:
        scene = _plain(plain, seed, size_px)
        scene = {"motion_blur": _blurred, "color_crossing": _crossing, "clutter": _cluttered}[name](
            scene, rng
        )
    about = replace(scene.scenario.about, description=f"A random scene: {name}.")
    return replace(scene, nuisance=name, scenario=replace(scene.scenario, about=about))


def _plain(number: int, seed: int, size_px: tuple[int, int]) -> Scene:
    """Draw one scene without a nuisance condition."""
    return random_scene(number * len(NUISANCE_CONDITIONS), seed, size_px=size_px)


def _scaled(number: int, seed: int, size_px: tuple[int, int], scale: float) -> Scene:
    """Draw a scene of another resolution; a finer sensor sees the blur of the same lens."""
    scene = _plain(number, seed, (round(scale * size_px[0]), round(scale * size_px[1])))
    camera = scene.scenario.camera
    return _with(scene, camera=replace(camera, blur_px=camera.blur_px * max(scale, 1.0)))


def _blurred(scene: Scene, rng: Rng) -> Scene:
    """Blur by the motion of the needle, or of the camera."""
    camera, scale = scene.scenario.camera, scene.scenario.camera.height_px / 720
    if rng.random() < 0.5:
        return _with(scene, camera=replace(camera, shutter_s=rng.uniform(*SHUTTER_S)))
    shake_px, shake_deg = scale * rng.uniform(*SHAKE_PX), rng.uniform(0, 180)
    return _with(scene, camera=replace(camera, shake_px=shake_px, shake_deg=shake_deg))


def _crossing(scene: Scene, rng: Rng) -> Scene:
    """Put a grey needle before a brown bowl that is as bright as the needle somewhere."""
    blue, green, red = BROWN_BGR
    shade = BROWN_TOP_SHADE + (BROWN_BOTTOM_SHADE - BROWN_TOP_SHADE) * rng.uniform(*CROSSING_AT)
    grey = shade * (0.114 * blue + 0.587 * green + 0.299 * red)
    needle = replace(scene.scenario.needle, brightness=grey / 255 / MEAN_TONE, highlight=0.0)
    texture = scene.scenario.appearance.texture
    appearance = Appearance("light", texture, bowl_bgr=BROWN_BGR, bowl_shade=BROWN_TOP_SHADE)
    return replace(_with(scene, needle=needle, appearance=appearance), polarity="crossing")


def _with_cannula(number: int, seed: int, size_px: tuple[int, int], rng: Rng) -> Scene:
    """Draw a scene with a cannula; without a needle, or with one that comes to rest outside the tube."""
    reach_mm, clearance_mm = rng.uniform(*REACH_MM), rng.uniform(*CLEARANCE_MM)
    brightness, highlight = rng.uniform(0.3, 0.8), rng.uniform(0.0, 0.4)
    while True:
        scene = _plain(number, seed, size_px)
        cannula = CannulaShape(
            scene.scenario.needle.diameter_mm + clearance_mm, reach_mm, brightness, highlight
        )
        depth_mm = _rest_depth_mm(scene.scenario)
        eye = Eye(scene.scenario.eye)
        if depth_mm is None or not is_in_cannula(cannula, eye, depth_mm - BEYOND_CANNULA_MM):
            return _with(scene, cannula=cannula)
        number += 1000  # far beyond those of other scenes


def _cluttered(scene: Scene, rng: Rng) -> Scene:
    """Add static distractors, of which the reference image shows some."""
    eye = Eye(scene.scenario.eye)
    registered = Distractors(
        specular_highlights=int(rng.integers(2, 6)),
        vessels=int(rng.integers(2, 7)),
        lines=int(rng.integers(1, 4)),
    )
    present = replace(
        with_second_instrument(registered, rng, eye, _rest_mm(scene.scenario, eye)),
        specular_highlights=registered.specular_highlights + int(rng.integers(1, 5)),
        vessels=registered.vessels + int(rng.integers(0, 3)),
        lines=registered.lines + int(rng.integers(0, 3)),
    )
    if rng.random() < 0.5:  # the second instrument was there before
        registered = replace(
            registered,
            light_pipe_mm=present.light_pipe_mm,
            light_pipe_deg=present.light_pipe_deg,
            light_pipe=present.light_pipe,
        )
    return replace(_with(scene, distractors=present), registered=registered)


def _with(scene: Scene, **changes: object) -> Scene:
    """Return a scene with some tables of its scenario replaced."""
    return replace(scene, scenario=replace(scene.scenario, **changes))


def _rest_depth_mm(scenario: Scenario) -> float | None:
    """Return the depth at which the needle comes to rest; None without a needle."""
    depths_mm = [move.depth_mm for move in scenario.moves if not move.away]
    return depths_mm[-1] if depths_mm else None


def _rest_mm(scenario: Scenario, eye: Eye) -> Vec:
    """Return where the tip comes to rest; without a needle, the globe's centre."""
    moves = [move for move in scenario.moves if not move.away]
    if not moves:
        return 0.0, 0.0
    along = rotate(unit(subtract(eye.target_mm, eye.trocar_mm)), moves[-1].theta_deg)
    x, y = eye.trocar_mm
    return x + moves[-1].depth_mm * along[0], y + moves[-1].depth_mm * along[1]
