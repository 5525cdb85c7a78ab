import math

import numpy as np
import pytest
from eye_bench import Bench

from haptigraph.errors import BadInput
from haptigraph.geometry import Point, angle_between_deg, norm, subtract
from haptigraph.messages import Observation
from haptigraph.perception.needle.tracker import Tracker
from haptigraph.sim.eye.optics import CameraSettings

INWARDS = [-3.0, -2.6, -2.2, -1.8, -1.4, -0.6, 0.2, 1.3, 1.8, 2.3, 2.9, 3.5, 4.1, 4.7, 5.3, 5.9, 6.5, 7.1]


@pytest.fixture(scope="module", params=["light", "dark"])
def bench(request):
    return Bench(request.param, Tracker, CameraSettings())


@pytest.fixture(autouse=True)
def fresh(request):
    if "bench" in request.fixturenames:
        request.getfixturevalue("bench").perceive.reset()


def miss_px(bench: Bench, observation: Observation) -> float:
    tip = observation.found["needle_tip"]
    assert isinstance(tip, Point)
    return norm(subtract(tip.at_mm, bench.robot.tip_mm())) * bench.settings.px_per_mm


def turn_deg(bench: Bench, observation: Observation) -> float:
    line = observation.found["needle_line"]
    return angle_between_deg(subtract(line.end_mm, line.start_mm), bench.robot.direction())


@pytest.mark.parametrize("depth_mm", [4.0, 10.0, 18.0, 20.5])
@pytest.mark.parametrize("theta_deg", [-6.0, 0.0, 5.0])
def test_a_needle_is_found_where_it_is_in_the_first_image(bench, depth_mm, theta_deg):
    observation = bench.observe(bench.image(depth_mm, theta_deg))
    assert miss_px(bench, observation) < 2.0
    assert turn_deg(bench, observation) < 0.5


def test_a_needle_is_followed_from_outside_through_the_wall(bench):
    for number, depth_mm in enumerate(INWARDS):
        observation = bench.observe(bench.image(depth_mm, 3.0, number), number)
        seen = "needle_tip" in observation.found
        if -0.9 < depth_mm < 0.9:  # in the wall
            assert not seen
        elif (depth_mm < -1.5 and number > 0) or depth_mm > 1.5:
            assert seen
            assert miss_px(bench, observation) < 1.5
            assert turn_deg(bench, observation) < 0.5


@pytest.mark.parametrize("depth_mm", [-2.4, -1.8, -1.5])
def test_a_needle_right_before_the_wall_is_seen_before_ground_never_seen_without_it(bench, depth_mm):
    first, *later = [bench.observe(bench.image(depth_mm, 3.0, number), number) for number in range(6)]
    assert sum("needle_tip" in observation.found for observation in later) >= 4
    assert all(miss_px(bench, seen) < 2.0 for seen in (first, *later) if "needle_tip" in seen.found)


@pytest.mark.parametrize("outside_deg", [-6.0, 0.0, 6.0])
@pytest.mark.parametrize("inside_deg", [-6.0, 0.0, 6.0])
def test_a_needle_seen_outside_from_the_first_image_on_is_seen_as_soon_as_it_is_inside(
    bench, outside_deg, inside_deg
):
    turns = np.interp(range(5), [0, 4], [outside_deg, inside_deg])
    way = [*((-2.0, outside_deg),) * 4, *zip([-1.4, -0.6, 0.2, 1.3, 1.3], turns, strict=True)]
    seen = [
        "needle_tip" in bench.observe(bench.image(depth_mm, theta_deg, number), number).found
        for number, (depth_mm, theta_deg) in enumerate(way)
    ]
    assert seen[:4] == [True] * 4
    assert seen[-3:] == [False, True, True]


def test_a_needle_in_the_wall_from_the_first_image_on_has_no_tip(bench):
    for number, depth_mm in enumerate((-0.7, -0.3, 0.0, 0.4, 0.7)):
        assert "needle_tip" not in bench.observe(bench.image(depth_mm, 3.0, number), number).found


def test_a_needle_that_leaves_is_gone_in_the_same_image(bench):
    bench.follow([10.0, 10.2, 10.4, 10.6])
    assert "needle_tip" not in bench.observe(bench.image(-12.0, 0.0, 4), 4).found
    assert "needle_tip" in bench.observe(bench.image(11.0, 0.0, 5), 5).found


def test_a_needle_that_was_inside_is_found_again_outside(bench):
    bench.follow([10.0, 10.2, 10.4, 10.6])
    for number in range(4, 24):
        observation = bench.observe(bench.image(-2.5, 0.0, number), number)
        assert "needle_tip" in observation.found
        assert miss_px(bench, observation) < 3.0


def test_an_empty_eye_has_no_needle_in_any_of_many_images(bench):
    for number in range(20):
        assert "needle_tip" not in bench.observe(bench.image(-12.0, 0.0, number), number).found


def test_a_fast_needle_is_followed_without_lag(bench):
    for number in range(24):
        observation = bench.observe(bench.image(4.0 + 0.66 * number, 0.0, number), number)  # 20 mm/s
        assert miss_px(bench, observation) < 1.5


def test_certainty_is_about_as_large_as_the_error(bench):
    errors, deviations = [], []
    for number, depth_mm in enumerate(np.linspace(3, 20, 40)):
        observation = bench.observe(bench.image(float(depth_mm), 2.0, number), number)
        errors.append(turn_deg(bench, observation))
        deviations.append(observation.certainty.theta_sd_deg)
        assert 0.4 <= observation.certainty.confidence <= 1
    assert np.median(errors) < 3 * np.median(deviations)
    assert np.median(deviations) < 0.2


def test_flickering_light_does_not_move_the_needle(bench):
    bench.follow([8.0, 8.1, 8.2])
    image = bench.image(8.3, 0.0, 3)
    dim = np.clip(image * 0.8, 0, 255).astype(np.uint8)
    assert miss_px(bench, bench.observe(dim, 3)) < 1.5


def test_the_same_images_give_the_same_observations(bench):
    first = bench.follow(INWARDS, 2.0)
    bench.perceive.reset()
    assert bench.follow(INWARDS, 2.0) == first


def test_grey_images_are_as_good(bench):
    image = bench.image(12.0, 0.0)
    grey = bench.observe(np.ascontiguousarray(image[:, :, 1]))
    assert miss_px(bench, grey) < 2.0


def test_an_image_of_another_size_is_refused(bench):
    with pytest.raises(BadInput, match=r"image is 640 x 360 px, but the registration is for 1280 x 720"):
        bench.observe(np.zeros((360, 640, 3), np.uint8))


@pytest.mark.parametrize(
    ("image", "found"),
    [
        (np.zeros((720, 1280, 4), np.uint8), "uint8 values in 720 x 1280 x 4"),
        (np.zeros((720, 1280), np.uint16), "uint16 values in 720 x 1280"),
    ],
    ids=["four channels", "16 bits"],
)
def test_an_image_of_another_kind_is_refused(bench, image, found):
    with pytest.raises(BadInput, match=f"expected an image of 8 bits, grey or BGR, found {found}"):
        bench.observe(image)


def test_noise_of_the_angle_is_small_when_little_is_inside(bench):
    depths = [*np.arange(-3.0, 2.0, 0.25), *[2.0] * 20]
    held = bench.follow([float(depth) for depth in depths], 3.0)[-15:]
    angles = [
        math.degrees(math.atan2(*subtract(line.end_mm, line.start_mm)))
        for line in (observation.found["needle_line"] for observation in held)
    ]
    assert np.std(angles) < 0.3


def test_whatever_it_is_shown_it_neither_fails_nor_reports_nonsense(bench):
    rng = np.random.default_rng(0)
    for number in range(60):
        image = bench.image(float(rng.uniform(-5, 22)), float(rng.uniform(-20, 20)), number)
        spoilt = [
            rng.integers(0, 256, image.shape, np.uint8),
            np.full_like(image, rng.integers(256)),
            np.ascontiguousarray(image[::-1]),
            np.clip(image * rng.uniform(0, 4), 0, 255).astype(np.uint8),
            image,
        ]
        observation = bench.observe(spoilt[number % len(spoilt)], number)
        tip, certainty = observation.found.get("needle_tip"), observation.certainty
        assert (tip is None) == (certainty is None)
        if tip is not None:
            assert norm(tip.at_mm) < 40
            assert 0 < certainty.tip_sd_mm < 10 and 0 < certainty.theta_sd_deg < 90
