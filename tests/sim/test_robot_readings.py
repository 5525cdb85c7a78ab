"""A robot that reports its tip beside the camera: where the two agree, and where they must not."""

import math

import pytest
from helpers import mostly_slow
from msgspec.structs import replace
from robot_recordings import steps_of

from haptigraph.robot.setup import parse_setup
from haptigraph.sim.phantom import Phantom
from haptigraph.sim.robot.readings import ReadingsShape
from haptigraph.sim.scenario import load_scenario


def states(readings, seed=0):
    """Every moment and step of an approach."""
    scenario = replace(load_scenario("align_then_approach"), readings=readings)
    return [(moment, step) for moment, _, step in steps_of(scenario, seed)]


@pytest.mark.parametrize("seed", mostly_slow(range(4), 0, 2))
def test_a_healthy_robot_never_disagrees(seed):
    steps = states(ReadingsShape(), seed)
    named = [step.conclusion.state for _, step in steps]
    assert "robot_disagrees" not in named and "target_hit" in named
    assert named.count("robot_not_known") <= 1  # the first image, before the first sample arrives


@pytest.mark.parametrize(
    "wrong",
    [
        ReadingsShape(bend_mm=-1.0, bends_at_s=12.0),
        ReadingsShape(slip_mm=(0.6, -0.8)),
        pytest.param(ReadingsShape(bend_mm=1.0, bends_at_s=12.0), marks=pytest.mark.slow),
        pytest.param(ReadingsShape(slip_mm=(1.0, 0.0)), marks=pytest.mark.slow),
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
