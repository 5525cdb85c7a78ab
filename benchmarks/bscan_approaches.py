"""Lead time of the alarm before the tip reaches the RPE, in simulated approaches at clinical speed.

`python benchmarks/bscan_approaches.py [N] [--images M] [--figure FILE]`. Every approach has its own retina,
needle angle, breathing and heartbeat, and constant speed until the tip is at the RPE. M approaches are
simulated with images and the perceiver. The N others need no images: each resamples the errors of one of the
M, missed detections included. All run through the actual pipeline.
"""

import argparse
import math
from collections.abc import Callable, Iterator
from typing import NamedTuple

import cv2
import numpy as np

from haptigraph import assemble
from haptigraph.config import Config
from haptigraph.geometry import Geometry, Point, Polyline, Segment, Vec, height_on_polyline
from haptigraph.messages import Capture, Observation, Step
from haptigraph.pipeline import Pipeline
from haptigraph.registration.loading import parse_registration
from haptigraph.sim.oct.bscan import BscanCamera
from haptigraph.sim.oct.retina import Retina, Surfaces
from haptigraph.sim.oct.scenes import random_scene
from haptigraph.sim.robot.operator import Tremor

SPEED_MM_S = 0.4  # along the shaft: the maximum of the published controller of Arikan et al. 2025
RATE_HZ = 25.0
ABOVE_MM = 0.15  # start of an approach above the ILM
BELOW_RPE_MM = 0.25  # minimum depth of the scan below the RPE
ALARM = "near_rpe"
SUBRETINAL_SHARE, TARGET_SHARE = 0.9, 0.6
SEED = 11

Error = tuple[float, float] | None
"""Errors of the tip's height above RPE and above ILM [mm]; None: needle, ILM or RPE was not detected."""
NEIGHBOURS = 8  # errors are drawn from this number of images with the most similar height above the RPE


class Moment(NamedTuple):
    """Ground truth of one image of an approach."""

    number: int
    tip_mm: Vec
    direction: Vec
    surfaces: Surfaces
    above_rpe_mm: float
    above_ilm_mm: float


class Outcome(NamedTuple):
    """The result of one approach."""

    lead_ms: float
    """From the alarm until the tip is at the RPE; minus infinity: no alarm before that."""
    left_um: float
    """True height of the tip above the RPE at the alarm."""


class Approach:
    """One approach; its number is the seed of all parameters."""

    def __init__(self, number: int) -> None:
        self.scene = scene = random_scene(number, SEED, place="inside")
        self._rng = rng = np.random.default_rng((SEED, number))
        shape = scene.retina
        moving = {
            "breathing_mm": rng.uniform(0, 0.08),
            "breathing_hz": rng.uniform(0.15, 0.35),
            "heartbeat_mm": rng.uniform(0, 0.02),
            "heartbeat_hz": rng.uniform(0.8, 1.6),
        }
        self.scene = random_scene(number, SEED, place="inside", **moving)
        scan = scene.scan
        columns = np.arange(scan.width_px, dtype=np.float64)
        self.x_mm = (columns - (scan.width_px - 1) / 2) * scan.lateral_mm_per_px
        self._retina = Retina(self.scene.retina, self.x_mm, scene.seed)
        self._tremor = Tremor(rng.uniform(0, 0.01), 8.0, 12.0, scene.seed)
        self._thickness_mm = shape.thickness_mm

    def moments(self) -> Iterator[Moment]:
        """Yield image by image, up to the one in which the tip is at the RPE."""
        angle = math.radians(self.scene.angle_deg)
        direction = math.cos(angle), -math.sin(angle)
        x, y = self.scene.tip_x_mm, self._retina.rest_mm(self.scene.tip_x_mm)
        number, above_rpe_mm = 0, math.inf
        while above_rpe_mm > 0:
            time_s = number / RATE_HZ
            along_mm, across_mm = self._tremor.at(time_s)
            travel_mm = SPEED_MM_S * time_s - ABOVE_MM / math.sin(angle) + along_mm
            tip_mm = (
                x + travel_mm * direction[0] - across_mm * direction[1],
                y + travel_mm * direction[1] + across_mm * direction[0],
            )
            surfaces = self._retina.advance(time_s, 1 / RATE_HZ if number else 0.0, tip_mm)
            above_rpe_mm, above_ilm_mm = (
                tip_mm[1] - float(np.interp(tip_mm[0], self.x_mm, row)) for row in surfaces[:2][::-1]
            )
            yield Moment(number, tip_mm, direction, surfaces, above_rpe_mm, above_ilm_mm)
            number += 1


def play(approach: Approach, step: Callable[[Moment], Step]) -> Outcome:
    """Run an approach through a pipeline."""
    alarm: Moment | None = None
    last = None
    for moment in approach.moments():
        if moment.above_rpe_mm > 0:
            if step(moment).conclusion.state == ALARM:
                alarm = alarm or moment
            last = moment
    if alarm is None or last is None:
        return Outcome(-math.inf, -math.inf)
    beyond_mm = moment.above_rpe_mm  # at or below the RPE: it was reached between the last two images
    reached = last.number + last.above_rpe_mm / (last.above_rpe_mm - beyond_mm)
    return Outcome(1e3 * (reached - alarm.number) / RATE_HZ, 1e3 * alarm.above_rpe_mm)


def chosen(first: int, count: int) -> list[int]:
    """Return numbers of approaches whose scans include the tissue below the tip, as on a well-set OCT."""
    numbers: list[int] = []
    number = first
    while len(numbers) < count:
        approach = Approach(number)
        scan, retina = approach.scene.scan, Retina(approach.scene.retina, approach.x_mm, approach.scene.seed)
        lowest_mm = -scan.height_px * scan.axial_mm_per_px / 2 + BELOW_RPE_MM
        floor_mm = retina.rest_mm(approach.scene.tip_x_mm) - approach.scene.retina.thickness_mm
        if floor_mm - approach.scene.retina.breathing_mm > lowest_mm:
            numbers.append(number)
        number += 1
    return numbers


def with_images(number: int) -> tuple[Outcome, list[tuple[float, Error]]]:
    """Simulate an approach with images; return the outcome, and the tip's height and error in each image."""
    approach = Approach(number)
    scene, errors = approach.scene, []
    camera = BscanCamera(scene.scan, scene.appearance, scene.needle, scene.seed)
    run = pipeline(approach)

    def step(moment: Moment) -> Step:
        scan = camera.render(moment.surfaces, moment.tip_mm, moment.direction, moment.number)
        done = run.step(Capture(moment.number, stamp_ns(moment), scan.image))
        errors.append((moment.above_rpe_mm, error_of(done.observation, moment)))
        return done

    return play(approach, step), errors


def error_of(observation: Observation, moment: Moment) -> Error:
    """Return the errors in an image."""
    tip, ilm, rpe = (observation.found.get(name) for name in ("needle_tip", "ilm", "rpe"))
    if not isinstance(tip, Point) or not isinstance(ilm, Polyline) or not isinstance(rpe, Polyline):
        return None
    x, y = tip.at_mm
    return (
        y - height_on_polyline(x, rpe) - moment.above_rpe_mm,
        y - height_on_polyline(x, ilm) - moment.above_ilm_mm,
    )


def without_images(number: int, errors: list[tuple[float, Error]]) -> Outcome:
    """Simulate an approach with the ground truth and randomly drawn errors."""
    approach, rng = Approach(number), np.random.default_rng((SEED, 7, number))
    current: list[Observation] = []
    run = pipeline(approach, lambda capture: current[-1])

    def step(moment: Moment) -> Step:
        nearest = sorted(errors, key=lambda one: abs(one[0] - moment.above_rpe_mm))[:NEIGHBOURS]
        _, error = nearest[int(rng.integers(len(nearest)))]
        current.append(observation(approach, moment, error))
        return run.step(Capture(moment.number, stamp_ns(moment), np.zeros((1, 1), np.uint8)))

    return play(approach, step)


def observation(approach: Approach, moment: Moment, error: Error) -> Observation:
    """Return the observation of a perceiver with an error."""
    if error is None:
        return Observation(stamp_ns(moment))
    x, ilm, rpe = approach.x_mm[::8], moment.surfaces.ilm_mm[::8], moment.surfaces.rpe_mm[::8]
    ilm, rpe = ilm - error[1], rpe - error[0]
    layers = {
        "ilm": ilm,
        "retina_surface": ilm,
        "rpe": rpe,
        "subretinal_space": ilm + SUBRETINAL_SHARE * (rpe - ilm),
        "target_layer": ilm + TARGET_SHARE * (rpe - ilm),
    }
    found: dict[str, Geometry] = {
        name: Polyline(tuple(zip(x.tolist(), row.tolist(), strict=True))) for name, row in layers.items()
    }
    (tip_x, tip_y), (dx, dy) = moment.tip_mm, moment.direction
    found["needle_tip"] = Point(moment.tip_mm)
    found["needle_line"] = Segment((tip_x - dx, tip_y - dy), moment.tip_mm)
    return Observation(stamp_ns(moment), found)


def stamp_ns(moment: Moment) -> int:
    """Return the time stamp of an image."""
    return round(moment.number * 1e9 / RATE_HZ)


def pipeline(approach: Approach, perceive: Callable[[Capture], Observation] | None = None) -> Pipeline:
    """Return a pipeline with the shipped procedure."""
    scan = approach.scene.scan
    text = (
        f"format = 1\n[image]\nwidth = {scan.width_px}\nheight = {scan.height_px}\n[scale]\n"
        f"axial_mm_per_px = {scan.axial_mm_per_px}\nlateral_mm_per_px = {scan.lateral_mm_per_px}\n"
        f"[target]\ndepth_share = {TARGET_SHARE}\n"
    )
    procedure = assemble.load_procedure("subretinal_injection_ioct")
    config = Config().with_perceiver("bscan")
    stub = None if perceive is None else Stub(perceive)
    return assemble.build_pipeline(config, parse_registration(text, "scene"), procedure, stub)


class Stub:
    """A perceiver that calls a function."""

    def __init__(self, perceive: Callable[[Capture], Observation]) -> None:
        self._perceive = perceive

    def __call__(self, capture: Capture) -> Observation:
        """Return the function's observation."""
        return self._perceive(capture)

    def reset(self) -> None:
        """Do nothing."""


def print_outcomes(name: str, outcomes: list[Outcome]) -> None:
    """Print how often the alarm came in time, and the distribution of its lead."""
    leads = np.array([outcome.lead_ms for outcome in outcomes])
    left = np.array([outcome.left_um for outcome in outcomes if outcome.lead_ms > 0])
    in_time = int((leads > 0).sum())
    print(f"{name}: alarm before the RPE in {in_time} of {len(outcomes)}")
    if in_time:
        ms, um = (np.percentile(values, (0, 1, 5, 50, 95)) for values in (leads[leads > 0], left))
        for label, values in (("lead [ms]", ms), ("left [µm]", um)):
            text = "min {:.0f}  1 % {:.0f}  5 % {:.0f}  median {:.0f}  95 % {:.0f}".format(*values)
            print(f"  {label}      {text}")


def draw(outcomes: list[Outcome], output: str) -> None:
    """Draw the distribution of the lead."""
    from matplotlib.figure import Figure

    sheet = Figure(figsize=(9, 3.2), layout="constrained")
    lead, left = sheet.subplots(1, 2)
    outcomes = [outcome for outcome in outcomes if outcome.lead_ms > 0]
    lead.hist([outcome.lead_ms for outcome in outcomes], 40, color="#20507a")
    lead.set(xlabel="alarm before the tip is at the RPE [ms]", ylabel="approaches", xlim=(0, None))
    left.hist([outcome.left_um for outcome in outcomes], 40, color="#20507a")
    left.set(xlabel="true distance left at the alarm [µm]", xlim=(0, None))
    for axes in (lead, left):
        axes.spines[["top", "right"]].set_visible(False)
    sheet.suptitle(
        f"{len(outcomes)} simulated approaches at {SPEED_MM_S} mm/s along the shaft, {RATE_HZ:.0f} B-scans/s"
    )
    sheet.savefig(output, dpi=100)


def main() -> None:
    """Simulate, print and draw."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("approaches", nargs="?", type=int, default=1000)
    parser.add_argument("--images", type=int, default=40)
    parser.add_argument("--figure")
    options = parser.parse_args()
    cv2.setNumThreads(1)
    numbers = chosen(0, options.images + options.approaches)
    simulated = [with_images(number) for number in numbers[: options.images]]
    print_outcomes(f"with images ({options.images})", [outcome for outcome, _ in simulated])
    errors = [errors for _, errors in simulated]
    missed = [error is None for each in errors for _, error in each]
    error_um = 1e3 * np.array([error[0] for each in errors for _, error in each if error])
    spread = f"median {np.median(error_um):+.0f}, 95 % within {np.percentile(np.abs(error_um), 95):.0f}"
    print(f"  error above the RPE [µm]: {spread}; not detected in {100 * np.mean(missed):.1f} % of images")
    rng = np.random.default_rng(SEED)
    outcomes = [
        without_images(number, errors[int(rng.integers(len(errors)))]) for number in numbers[options.images :]
    ]
    print_outcomes(f"with these errors, without images ({options.approaches})", outcomes)
    if options.figure:
        draw(outcomes, options.figure)


if __name__ == "__main__":
    main()
