"""A robot that reports its tip beside the camera: where the two agree, and where they must not."""

import math

import numpy as np
import pytest
from msgspec.structs import replace

from haptigraph import assemble
from haptigraph.config import load_config
from haptigraph.geometry import Point
from haptigraph.messages import Capture, Certainty, Observation
from haptigraph.perception.robot_tip import RobotTipPerceiver
from haptigraph.registration.loading import parse_registration
from haptigraph.robot.setup import parse_setup
from haptigraph.sim.phantom import Phantom
from haptigraph.sim.robot.readings import ReadingsShape
from haptigraph.sim.scenario import load_scenario

TRACKER_SD_MM = 0.03


class TrackerLike:
    """Reports the true needle with noise, as the tracker would, without drawing images."""

    def __init__(self, anatomy, seed):
        self.anatomy, self.random = anatomy, np.random.default_rng(seed)

    def __call__(self, capture):
        from haptigraph.geometry import Segment

        x, y = capture.truth.tip_mm + self.random.normal(0, TRACKER_SD_MM, 2)
        tip = Point((float(x), float(y)))
        line = Segment(self.anatomy["trocar"].at_mm, tip.at_mm)
        found = {**self.anatomy, "needle_tip": tip, "needle_line": line}
        return Observation(capture.stamp_ns, found, certainty=Certainty(1.0, TRACKER_SD_MM, 0.2))

    def reset(self):
        pass


def states(readings, seed=0):
    """The state at every image of an approach, and what is apart."""
    scenario = replace(load_scenario("align_then_approach"), readings=readings)
    scenario = replace(scenario, about=replace(scenario.about, seed=seed))
    phantom = Phantom(scenario)
    registration = parse_registration(phantom.registration, "phantom")
    procedure = assemble.load_procedure("subretinal_injection_robot")
    tracker = TrackerLike(registration.anatomy, seed)
    pipeline = assemble.build_pipeline(
        load_config(), registration, procedure, RobotTipPerceiver(tracker, timing_sd_ms=5.0)
    )
    found = []
    while (moment := phantom.advance(draws=False)) is not None:
        stamp_ns = round(moment.time_s * 1e9)
        image = np.zeros((1, 1, 3), np.uint8)
        capture = Capture(len(found), stamp_ns, image, truth=moment.truth, robot=moment.robot)
        found.append((moment, pipeline.step(capture)))
    return found


@pytest.mark.parametrize("seed", range(4))
def test_a_healthy_robot_never_disagrees(seed):
    steps = states(ReadingsShape(), seed)
    named = [step.conclusion.state for _, step in steps]
    assert "robot_disagrees" not in named and "target_hit" in named
    assert named.count("robot_not_known") <= 1  # the first image, before the first sample arrives


@pytest.mark.parametrize(
    "wrong",
    [
        ReadingsShape(bend_mm=1.0, bends_at_s=12.0),
        ReadingsShape(bend_mm=-1.0, bends_at_s=12.0),
        ReadingsShape(slip_mm=(1.0, 0.0)),
        ReadingsShape(slip_mm=(0.6, -0.8)),
    ],
)
def test_a_needle_bent_or_a_place_slipped_by_1_mm_is_felt_and_success_is_not(wrong):
    inside = [step for moment, step in states(wrong) if moment.truth.inside and moment.time_s > 12.1]
    felt = [step.command.pattern.name for step in inside]
    assert felt.count("doubt") > 0.95 * len(felt)
    assert "success" not in felt and not {*felt} - {"doubt", "pulse", "off"}


def test_a_lag_that_matters_is_covered_by_no_margin():
    steps = states(ReadingsShape(stamps_late_ms=400.0))
    assert "robot_disagrees" in [step.conclusion.state for _, step in steps]


def test_the_simulated_setup_takes_the_base_to_the_eye():
    phantom = Phantom(load_scenario("bent_needle"))
    setup = parse_setup(phantom.robot_setup, "simulated robot")
    eye_from_base = setup.eye.robot_from_eye.inverse()
    sample = next(one for _ in range(30) for one in phantom.advance(draws=False).robot)
    assert math.dist(eye_from_base.point_mm(sample.position_mm), sample.eye_tip_mm) < 1e-6
    assert math.dist(eye_from_base.point_mm(setup.rcm.at_mm)[:2], phantom.eye.trocar_mm) < 1e-6
