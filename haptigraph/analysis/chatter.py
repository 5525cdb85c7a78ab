"""How often the state flickers because measuring is noisy: a simulated needle rests at each threshold.

What perception would say of it is its true place with normal noise, anew in each image, as strong as the
tracker's was measured to be. Knows no images and no touch.
"""

import math
from collections.abc import Iterable, Iterator, Sequence
from typing import NamedTuple

import numpy as np

from haptigraph.geometry import Geometry, Point, Segment, Vec, rotate, subtract, unit
from haptigraph.graph import SceneGraph
from haptigraph.inference.engine import RuleEngine
from haptigraph.inference.procedure import Procedure
from haptigraph.messages import Observation
from haptigraph.scene.builder import SchemaSceneBuilder

__all__ = [
    "CONTACT",
    "NOISE",
    "Needle",
    "Noise",
    "alarm_delays",
    "approaches",
    "conclude",
    "observe",
    "resting_places",
]

RATE_HZ = 30.0
CONTACT = "retinal_contact"


class Noise(NamedTuple):
    """Deviation of what perception says, per image."""

    tip_mm: float
    """Of the tip, in each of two directions."""
    theta_deg: float
    """Of the shaft's direction."""


NOISE = Noise(tip_mm=0.0065, theta_deg=0.04)
"""The most that was measured of the tracker at any depth: `benchmarks/chatter.py` measures it anew."""


class Needle(NamedTuple):
    """Where the needle is."""

    depth_mm: float
    """From the trocar to the tip."""
    theta_deg: float
    """To the line trocar -> target, counter-clockwise."""


def observe(
    anatomy: dict[str, Geometry], needles: Iterable[Needle], noise: Noise, seed: int
) -> Iterator[Observation]:
    """Yield what perception says of a needle, image by image, 30 a second.

    Args:
        anatomy: What a registration knows.
        needles: Where the needle is in each image.
        noise: Added to it.
        seed: Of the noise.
    """
    rng = np.random.default_rng(seed)
    for number, needle in enumerate(needles):
        x, y = _tip_mm(anatomy, needle)
        off_x, off_y, turn = rng.standard_normal(3) * (noise.tip_mm, noise.tip_mm, noise.theta_deg)
        tip_mm = float(x + off_x), float(y + off_y)
        along = rotate(_axis(anatomy), needle.theta_deg + float(turn))
        entry_mm = tip_mm[0] - 10.0 * along[0], tip_mm[1] - 10.0 * along[1]
        found = {**anatomy, "needle_tip": Point(tip_mm), "needle_line": Segment(entry_mm, tip_mm)}
        yield Observation(round(number * 1e9 / RATE_HZ), found)


def conclude(procedure: Procedure, observations: Iterable[Observation]) -> list[str]:
    """Return the state of every image."""
    build_scene, reason = SchemaSceneBuilder(procedure.schema), RuleEngine(procedure)
    return [reason(build_scene(observation)).state for observation in observations]


def resting_places(anatomy: dict[str, Geometry], procedure: Procedure) -> dict[str, Needle]:
    """Return a needle that rests on each threshold of the paper's procedure, by what it rests on."""
    side = 4.0  # degrees: well off the target, but over the retina

    def found(measure: str, value: float, theta_deg: float, low_mm: float, high_mm: float) -> Needle:
        """Push the needle in until a measure has a value that lies between those at both depths."""
        build_scene = SchemaSceneBuilder(procedure.schema)

        def measured(depth_mm: float) -> SceneGraph:
            build_scene.reset()
            return build_scene(next(observe(anatomy, [Needle(depth_mm, theta_deg)], Noise(0.0, 0.0), seed=0)))

        rises = measured(high_mm).measures[measure] > measured(low_mm).measures[measure]
        for _ in range(50):
            middle_mm = (low_mm + high_mm) / 2
            below = measured(middle_mm).measures[measure] < value
            low_mm, high_mm = (middle_mm, high_mm) if below == rises else (low_mm, middle_mm)
        return Needle(low_mm, theta_deg)

    grazing_deg = math.degrees(math.asin(0.7 / 22.0))
    touching = found("distance_to_retina_mm", 0.3, grazing_deg, 15.0, 25.0)
    return {
        "wall 0 mm": found("wall_mm", 0.0, side, 0.0, 3.0),
        "theta 1.7 deg": Needle(10.0, 1.7),
        "retina 5.5 mm": found("distance_to_retina_mm", 5.5, side, 10.0, 20.0),
        "retina 0.7 mm": found("distance_to_retina_mm", 0.7, side, 15.0, 22.0),
        "axis 0.7 mm": Needle(touching.depth_mm, math.degrees(math.asin(0.7 / touching.depth_mm))),
    }


def approaches(count: int, seed: int) -> Iterator[list[Needle]]:
    """Yield needles that are pushed from 12 mm to beyond the retina, off the target, 1 to 20 mm/s."""
    rng = np.random.default_rng(seed)
    for _ in range(count):
        theta_deg = float(rng.choice((-1.0, 1.0)) * rng.uniform(2.5, 12.0))
        mm_per_image = float(rng.uniform(1.0, 20.0)) / RATE_HZ
        images = math.ceil(15.0 / mm_per_image)
        yield [Needle(12.0 + number * mm_per_image, theta_deg) for number in range(images)]


def alarm_delays(plain: Procedure, steady: Procedure, observations: Sequence[Observation]) -> int:
    """Return how many images later the alarm is raised under one procedure than under another.

    Raises:
        ValueError: If one of them never raises it.
    """
    return conclude(steady, observations).index(CONTACT) - conclude(plain, observations).index(CONTACT)


def _axis(anatomy: dict[str, Geometry]) -> Vec:
    trocar, target = anatomy["trocar"], anatomy["retina_target"]
    if not isinstance(trocar, Point) or not isinstance(target, Point):
        raise ValueError("the anatomy has no trocar or no target")
    return unit(subtract(target.at_mm, trocar.at_mm))


def _tip_mm(anatomy: dict[str, Geometry], needle: Needle) -> Vec:
    trocar, along = anatomy["trocar"], rotate(_axis(anatomy), needle.theta_deg)
    if not isinstance(trocar, Point):
        raise ValueError("the anatomy has no trocar")
    return (
        trocar.at_mm[0] + needle.depth_mm * along[0],
        trocar.at_mm[1] + needle.depth_mm * along[1],
    )
