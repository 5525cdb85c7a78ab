"""Record a simulated robot and a tracker-like perceiver, without drawing images."""

from pathlib import Path

import numpy as np
from msgspec.structs import replace

from haptigraph import assemble
from haptigraph.clock import VirtualClock
from haptigraph.config import load_config
from haptigraph.geometry import Point, Segment
from haptigraph.messages import Capture, Certainty, Observation
from haptigraph.perception.robot_tip import RobotTipPerceiver
from haptigraph.recording.writer import RunWriter
from haptigraph.registration.loading import parse_registration
from haptigraph.run_header import run_info
from haptigraph.sim.phantom import Phantom
from haptigraph.sim.robot.operator import Move
from haptigraph.sim.robot.readings import ReadingsShape
from haptigraph.sim.scenario import Scenario, load_scenario
from haptigraph.stages import Source

TRACKER_SD_MM = 0.03
BLACK = np.zeros((1, 1, 3), np.uint8)


class TrackerLike:
    """Reports the true needle with noise, as the tracker would, without images."""

    def __init__(self, anatomy, seed):
        self.anatomy, self.random = anatomy, np.random.default_rng(seed)

    def __call__(self, capture):
        x, y = capture.truth.tip_mm + self.random.normal(0, TRACKER_SD_MM, 2)
        tip = Point((float(x), float(y)))
        line = Segment(self.anatomy["trocar"].at_mm, tip.at_mm)
        found = {**self.anatomy, "needle_tip": tip, "needle_line": line}
        return Observation(capture.stamp_ns, found, certainty=Certainty(1.0, TRACKER_SD_MM, 0.2))

    def reset(self):
        pass


def steps_of(scenario: Scenario, seed: int = 0):
    """Yield every moment of a scenario with its capture and step."""
    phantom = Phantom(replace(scenario, about=replace(scenario.about, seed=seed)))
    registration = parse_registration(phantom.registration, "phantom")
    procedure = assemble.load_procedure("subretinal_injection_robot")
    perceive = RobotTipPerceiver(TrackerLike(registration.anatomy, seed), timing_sd_ms=5.0)
    pipeline = assemble.build_pipeline(load_config(), registration, procedure, perceive)
    index = 0
    while (moment := phantom.advance(draws=False)) is not None:
        stamp_ns = round(moment.time_s * 1e9)
        capture = Capture(index, stamp_ns, BLACK, truth=moment.truth, robot=moment.robot)
        yield moment, capture, pipeline.step(capture)
        index += 1


def wandering(readings: ReadingsShape, seconds: float = 14.0) -> Scenario:
    """A scenario in which the needle goes to and fro inside the eye."""
    random, moves = np.random.default_rng(8), []
    while sum(move.duration_s for move in moves) < seconds:
        depth_mm, theta_deg = float(random.uniform(5, 20)), float(random.uniform(-9, 9))
        moves.append(Move(float(random.uniform(0.8, 2.0)), depth_mm, theta_deg))
    return replace(load_scenario("align_then_approach"), moves=tuple(moves), readings=readings)


def record(path: Path, readings: ReadingsShape) -> Scenario:
    """Record such a run, and return its scenario."""
    scenario = wandering(readings)
    phantom = Phantom(scenario)
    registration = parse_registration(phantom.registration, "phantom")
    procedure = assemble.load_procedure("subretinal_injection_robot")

    class Played(Source):
        rate_hz, is_live = 30.0, False

    info = run_info(
        load_config(), Played(), registration, procedure, VirtualClock(), "0", phantom.robot_setup or ""
    )
    writer = RunWriter(path, info, registration.image, procedure.schema.measure_names)
    for _, capture, step in steps_of(scenario):
        writer.write(capture, step)
    writer.close()
    return scenario
