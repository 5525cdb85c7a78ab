"""Angle and tip out of the section from simulated depth images with a D405's noise, and their uncertainty.

`python benchmarks/depth.py [--scenes N] [--seed N]`. Each scene is a random one of the simulator, before a
D405 at 75 to 95 mm: eye, needle, light and nuisance condition vary, and the needle leans up to 30 degrees out
of the section. In every other scene the shaft outside the eye has the depth of what is behind it. The last
image of each scene counts.
"""

import argparse
import math
from collections.abc import Iterator, Sequence
from itertools import product
from typing import NamedTuple

import numpy as np
from msgspec.structs import replace

from haptigraph import assemble
from haptigraph.config import load_config
from haptigraph.geometry import Segment
from haptigraph.messages import Capture, Observation
from haptigraph.perception.entities import NEEDLE_3D
from haptigraph.registration.loading import parse_registration
from haptigraph.sim.eye.depth import DepthShape
from haptigraph.sim.phantom import Phantom
from haptigraph.sim.robot.operator import Move
from haptigraph.sim.scenario import Scenario
from haptigraph.sim.scenes import random_scene
from haptigraph.sources.phantom import capture_of

SIZE_PX = 640, 360
FOCAL_PX = 674.3  # of the D405 at 1280 x 720 px
DISTANCE_MM = 75.0, 95.0
MAX_LEAN_DEG = 30.0
LENGTHS_MM = 3.0, 20.0
BINS_MM = (3.0, 5.0), (5.0, 8.0), (8.0, 12.0), (12.0, 20.0)
LIMIT_DEG = 2.0
PERIOD_NS = 100_000_000  # a needle at rest needs few images
ROWS = (
    "visible mm",
    "scenes",
    "reported",
    "angle p50",
    "p68",
    "p95",
    "<= 2 deg",
    "|e|/sd p68",
    "p95",
    "tip p68 mm",
    "p95",
    "|e|/sd p68",
    "p95",
)


class Result(NamedTuple):
    """One scene."""

    stated: bool
    """Whether the needle's dimensions are given; otherwise its width is measured in the image."""
    outside: bool
    """Whether it is visible outside the eye."""
    length_mm: float
    angle_error_deg: float
    """Of the estimate; nan if none is reported."""
    angle_sd_deg: float
    tip_error_mm: float
    tip_sd_mm: float


def main() -> None:
    """Play the scenes, and print errors and their ratio to the standard deviations."""
    parser = argparse.ArgumentParser(
        description=__doc__,
        epilog="example: python benchmarks/depth.py --scenes 400 --seed 1",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--scenes", type=int, default=200)
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    results = [result for number in range(given.scenes) for result in results_of(number, given.seed)]
    for stated, outside in product((True, False), repeat=2):
        where = "outside the eye, too" if outside else "inside the eye only"
        print(f"\nneedle {'' if stated else 'not '}stated, visible {where}\n{'  '.join(ROWS)}")
        chosen = [result for result in results if (result.stated, result.outside) == (stated, outside)]
        for low, high in (*BINS_MM, LENGTHS_MM):
            print_row(low, high, [result for result in chosen if low <= result.length_mm < high])


def print_row(low: float, high: float, results: Sequence[Result]) -> None:
    """Print the figures of the scenes whose visible length is in one range."""
    count = len(results)
    numbers = np.array([result[3:] for result in results if not math.isnan(result.angle_error_deg)])
    cells = [f"{low:g} to {high:g}", str(count), f"{len(numbers) / max(count, 1):.0%}"]
    if len(numbers):
        angle, angle_sd, tip, tip_sd = np.abs(numbers).T
        cells += [f"{value:.2f}" for value in np.percentile(angle, (50, 68, 95))]
        cells += [f"{(angle <= LIMIT_DEG).mean():.1%}"]
        for values in (angle / angle_sd, tip, tip / tip_sd):
            cells += [f"{value:.2f}" for value in np.percentile(values, (68, 95))]
    print("  ".join(f"{cell:>{len(name)}}" for cell, name in zip(cells, ROWS, strict=False)), flush=True)


def results_of(number: int, seed: int) -> Iterator[Result]:
    """Yield the results of a scene; none if its needle is not found in the image at all."""
    outside = number % 2 == 0
    scenario = depth_scenario(number, seed, outside)
    phantom, needle = Phantom(scenario), scenario.needle
    config = load_config()
    shape = needle.tip_diameter_mm, needle.diameter_mm, needle.taper_mm
    stated = replace(config, perception=replace(config.perception, needle_mm=shape))
    registration = parse_registration(phantom.registration, "scene")
    procedure = assemble.load_procedure(config.run.procedure)
    pipelines = [assemble.build_pipeline(each, registration, procedure) for each in (stated, config)]
    captures: list[Capture] = []
    while (moment := phantom.advance()) is not None:
        captures.append(capture_of(moment, len(captures), len(captures) * PERIOD_NS))
    for pipeline in pipelines:
        *_, observation = [pipeline.perceive(capture) for capture in captures]
        if "needle_tip" in observation.found:
            yield scored(captures[-1], observation, pipeline is pipelines[0], outside)


def depth_scenario(number: int, seed: int, outside: bool) -> Scenario:
    """Return a random scene before a D405, in which the needle ends up visible over a random length."""
    scenario = random_scene(number, seed, size_px=SIZE_PX).scenario
    rng = np.random.default_rng((seed, 11, number))
    distance_mm, length_mm = rng.uniform(*DISTANCE_MM), rng.uniform(*LENGTHS_MM)
    lean_deg = rng.uniform(-MAX_LEAN_DEG, MAX_LEAN_DEG)
    depth_mm, theta_deg = length_mm + scenario.eye.wall_mm / 2, scenario.moves[0].theta_deg
    moves = Move(0.2, depth_mm, theta_deg, away=True), Move(0.3, depth_mm, theta_deg)
    return replace(
        scenario,
        about=replace(scenario.about, rate_hz=1e9 / PERIOD_NS),
        moves=moves,
        camera=replace(
            scenario.camera,
            px_per_mm=FOCAL_PX / distance_mm,
            distance_mm=distance_mm,
            center_px=(320.0, 200.0),
        ),
        needle=replace(scenario.needle, diameter_mm=rng.uniform(0.5, 0.9), tilt_deg=lean_deg),
        depth=DepthShape(scale_error=rng.uniform(-0.02, 0.02), outside=outside),
    )


def scored(capture: Capture, observation: Observation, stated: bool, outside: bool) -> Result:
    """Compare the shaft in space with the truth."""
    true = capture.truth.others[NEEDLE_3D] if capture.truth else None
    found, sd_mm = observation.found.get(NEEDLE_3D), observation.sd_mm.get(NEEDLE_3D)
    if not isinstance(true, Segment):
        raise TypeError("the scene has no shaft in space")
    length_mm = math.dist(true.start_mm, true.end_mm)
    if not isinstance(found, Segment) or not isinstance(sd_mm, float) or observation.certainty is None:
        return Result(stated, outside, length_mm, math.nan, math.nan, math.nan, math.nan)
    angle_sd_deg = observation.certainty.out_of_plane_sd_deg or math.nan
    return Result(
        stated,
        outside,
        length_mm,
        found.out_of_plane_deg - true.out_of_plane_deg,
        angle_sd_deg,
        found.end_z_mm - true.end_z_mm,
        sd_mm,
    )


if __name__ == "__main__":
    main()
