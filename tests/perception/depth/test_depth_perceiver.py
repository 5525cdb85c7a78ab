"""The shaft in space, before the simulated depth camera."""

import math

import numpy as np
import pytest
from depth import results_of
from helpers import mostly_slow
from msgspec.structs import replace
from paths import DATA

from haptigraph import assemble
from haptigraph.config import load_config
from haptigraph.geometry import Segment
from haptigraph.messages import DepthImage
from haptigraph.perception.depth.perceiver import DepthPerceiver
from haptigraph.registration.loading import parse_registration
from haptigraph.sim.phantom import Phantom
from haptigraph.sim.scenario import load_scenario
from haptigraph.sources.phantom import capture_of

SHAPE_MM = 0.12, 0.8, 4.0


def lean_deg(shaft):
    right, up, towards = shaft.along_mm
    return math.degrees(math.atan2(towards, math.hypot(right, up)))


def scenario(tilt_deg=12.0, **depth):
    given = load_scenario(str(DATA / "deep.toml"))
    return replace(
        given, needle=replace(given.needle, tilt_deg=tilt_deg), depth=replace(given.depth, **depth)
    )


def played(given, *settings):
    """The last capture, and what is observed in it."""
    phantom = Phantom(given)
    config = load_config(None, settings)
    registration = parse_registration(phantom.registration, "deep")
    pipeline = assemble.build_pipeline(config, registration, assemble.load_procedure(config.run.procedure))
    captures = []
    while (moment := phantom.advance()) is not None:
        captures.append(capture_of(moment, len(captures), len(captures) * 100_000_000))
    observations = [pipeline.perceive(capture) for capture in captures]
    pipeline.reset()
    return captures, observations, pipeline


STATED = f"perception.needle_mm={list(SHAPE_MM)}"


@pytest.mark.parametrize("tilt_deg", mostly_slow([-25.0, 0.0, 12.0], -25.0))
@pytest.mark.parametrize("settings", [(), (STATED,)], ids=["measured", "stated"])
def test_the_shaft_in_space_is_where_the_truth_says(tilt_deg, settings):
    captures, observations, _ = played(scenario(tilt_deg, scale_error=0.02), *settings)
    found, true = observations[-1].found["needle_3d"], captures[-1].truth.others["needle_3d"]
    sd_mm, sd_deg = observations[-1].sd_mm["needle_3d"], observations[-1].certainty.out_of_plane_sd_deg
    assert lean_deg(true) == pytest.approx(tilt_deg, abs=0.01)
    assert abs(lean_deg(found) - lean_deg(true)) < min(3 * sd_deg, 2.0)
    assert abs(found.end_z_mm - true.end_z_mm) < 3 * sd_mm
    assert math.dist(found.end_mm, true.end_mm) < 0.25
    assert sd_mm < 0.5


@pytest.mark.parametrize(("number", "seed"), [(54, 1), (172, 2)])
def test_depths_near_a_thin_tip_that_are_partly_the_backgrounds_do_not_turn_the_shaft(number, seed):
    reported = [each for each in results_of(number, seed) if not math.isnan(each.angle_error_deg)]
    assert all(abs(each.angle_error_deg) < 2.0 for each in reported)


def test_an_uncertain_tip_in_the_image_is_uncertain_out_of_the_section_where_the_shaft_leans():
    captures, observations, _ = played(scenario(-25.0), STATED)
    registration = parse_registration(Phantom(scenario(-25.0)).registration, "deep")
    certainty = replace(observations[-1].certainty, tip_sd_mm=1.0)
    known = replace(observations[-1], certainty=certainty)
    perceive = DepthPerceiver(lambda _: known, registration, registration.depth, SHAPE_MM)
    before, after = observations[-1].sd_mm["needle_3d"], perceive(captures[-1]).sd_mm["needle_3d"]
    assert after**2 - before**2 == pytest.approx(math.tan(math.radians(25.0)) ** 2, rel=0.1)


def test_a_stated_needle_is_known_better():
    (_, measured, _), (_, stated, _) = played(scenario()), played(scenario(), STATED)
    assert stated[-1].sd_mm["needle_3d"] < measured[-1].sd_mm["needle_3d"]


def test_without_depth_everything_else_is_the_same():
    captures, observations, pipeline = played(scenario())
    for capture, expected in zip(captures, observations, strict=True):
        flat = pipeline.perceive(replace(capture, depth=None))
        others = {name: shape for name, shape in expected.found.items() if name != "needle_3d"}
        certainty = expected.certainty and replace(expected.certainty, out_of_plane_sd_deg=None)
        assert flat == replace(expected, found=others, certainty=certainty, sd_mm={})
    assert "needle_3d" in observations[-1].found


@pytest.mark.parametrize("of", ["holes", "background", "flat"])
def test_depths_that_do_not_show_the_shaft_give_no_shaft_in_space(of):
    """A stereo camera may see through a thin bright shaft, or nothing at all."""
    captures, _, pipeline = played(scenario())
    empty = captures[0].depth  # the needle is away
    values = {
        "holes": np.zeros_like(empty.values),
        "background": empty.values,
        "flat": np.full_like(empty.values, 1100),
    }[of]
    replaced = DepthImage(values, empty.unit_mm, empty.left_px, empty.top_px)
    for capture in captures:
        observation = pipeline.perceive(replace(capture, depth=replaced))
        assert "needle_3d" not in observation.found
        assert observation.certainty is None or observation.certainty.out_of_plane_sd_deg is None
    assert "needle_line" in observation.found


def test_a_shaft_with_wrong_depths_outside_the_eye_is_measured_inside():
    captures, observations, _ = played(scenario(outside=False))
    found = observations[-1].found["needle_3d"]
    assert isinstance(found, Segment)
    assert lean_deg(found) == pytest.approx(lean_deg(captures[-1].truth.others["needle_3d"]), abs=2.0)


def test_a_tilted_camera_gives_the_same_shaft():
    given = scenario(8.0)
    tilted = replace(given, camera=replace(given.camera, tilt_deg=(4.0, -3.0)))
    _, observations, _ = played(tilted, STATED)
    found = observations[-1].found["needle_3d"]
    assert lean_deg(found) == pytest.approx(8.0, abs=2.0)
    assert abs(found.start_z_mm) < 0.5
