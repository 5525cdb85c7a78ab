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


def error_px(bench: Bench, observation: Observation) -> float:
    tip = observation.found["needle_tip"]
    assert isinstance(tip, Point)
    return norm(subtract(tip.at_mm, bench.robot.tip_mm())) * bench.settings.px_per_mm


def turn_deg(bench: Bench, observation: Observation) -> float:
    line = observation.found["needle_line"]
    return angle_between_deg(subtract(line.end_mm, line.start_mm), bench.robot.direction())


@pytest.mark.parametrize("depth_mm", [4.0, 10.0, 18.0, 20.5])
@pytest.mark.parametrize("theta_deg", [-6.0, 0.0, 5.0])
def test_locates_a_needle_in_the_first_image(bench, depth_mm, theta_deg):
    observation = bench.observe(bench.image(depth_mm, theta_deg))
    assert error_px(bench, observation) < 2.0
    assert turn_deg(bench, observation) < 0.5


def test_tracks_a_needle_from_outside_through_the_wall(bench):
    for number, depth_mm in enumerate(INWARDS):
        observation = bench.observe(bench.image(depth_mm, 3.0, number), number)
        is_reported = "needle_tip" in observation.found
        if -0.9 < depth_mm < 0.9:  # in the wall
            assert not is_reported
        elif (depth_mm < -1.5 and number > 0) or depth_mm > 1.5:
            assert is_reported
            assert error_px(bench, observation) < 1.5
            assert turn_deg(bench, observation) < 0.5


@pytest.mark.parametrize("depth_mm", [-2.4, -1.8, -1.5])
def test_locates_a_needle_right_before_a_wall_whose_background_is_unknown(bench, depth_mm):
    first, *later = [bench.observe(bench.image(depth_mm, 3.0, number), number) for number in range(6)]
    assert sum("needle_tip" in observation.found for observation in later) >= 4
    assert all(error_px(bench, each) < 2.0 for each in (first, *later) if "needle_tip" in each.found)


@pytest.mark.parametrize("outside_deg", [-6.0, 0.0, 6.0])
@pytest.mark.parametrize("inside_deg", [-6.0, 0.0, 6.0])
def test_a_needle_visible_outside_from_the_first_image_on_is_detected_soon_after_it_is_inside(
    bench, outside_deg, inside_deg
):
    turns = np.interp(range(5), [0, 4], [outside_deg, inside_deg])
    path = [*((-2.0, outside_deg),) * 4, *zip([-1.4, -0.6, 0.2, 1.3, 1.8], turns, strict=True)]
    path += [(depth_mm, inside_deg) for depth_mm in (2.2, 2.5, 2.7)]  # its first image inside may be doubtful
    is_reported = []
    for number, (depth_mm, theta_deg) in enumerate(path):
        observation = bench.observe(bench.image(depth_mm, theta_deg, number), number)
        is_reported.append("needle_tip" in observation.found)
    assert is_reported[:4] == [True] * 4
    assert not is_reported[6] and is_reported[-1]
    assert error_px(bench, observation) < 2.0


def test_reports_no_tip_of_a_needle_in_the_wall_from_the_first_image_on(bench):
    for number, depth_mm in enumerate((-0.7, -0.3, 0.0, 0.4, 0.7)):
        assert "needle_tip" not in bench.observe(bench.image(depth_mm, 3.0, number), number).found


def test_stops_reporting_a_needle_in_the_image_in_which_it_has_left(bench):
    bench.follow([10.0, 10.2, 10.4, 10.6])
    assert "needle_tip" not in bench.observe(bench.image(-12.0, 0.0, 4), 4).found
    assert "needle_tip" in bench.observe(bench.image(11.0, 0.0, 5), 5).found


def test_detects_a_needle_again_outside_that_was_inside(bench):
    bench.follow([10.0, 10.2, 10.4, 10.6])
    for number in range(4, 24):
        observation = bench.observe(bench.image(-2.5, 0.0, number), number)
        assert "needle_tip" in observation.found
        assert error_px(bench, observation) < 3.0


def test_reports_the_shaft_alone_of_a_needle_that_fades_before_its_tip():
    """The shaft ends before the true tip, so that nobody takes its end for one."""
    bench, shafts = Bench("dark", Tracker, CameraSettings()), []
    for number, depth_mm in enumerate(np.linspace(12.0, 12.7, 8)):
        observation = bench.observe(faded(bench, float(depth_mm), number), number)
        if "needle_tip" in observation.found:
            assert error_px(bench, observation) < 0.3 * bench.settings.px_per_mm
        else:
            shafts.append(observation)
            ends = observation.found["needle_line"]
            length_mm = norm(subtract(ends.end_mm, ends.start_mm))
            assert turn_deg(bench, observation) < 0.5
            assert depth_mm / 2 < length_mm < depth_mm
    assert len(shafts) >= 2
    assert all(each.certainty.tip_sd_mm is None for each in shafts)
    assert all(0 < each.certainty.theta_sd_deg < 1 for each in shafts)


def faded(bench: Bench, depth_mm: float, number: int, over_mm: float = 3.0) -> np.ndarray:
    """Return an image of a needle that turns into the eye behind it towards its tip."""
    empty, image = (bench.image(depth, 3.0, number).astype(float) for depth in (-12.0, depth_mm))
    tip_px = np.array(bench.registration.image.to_px(bench.robot.tip_mm()))
    behind_px = np.array(
        bench.registration.image.to_px(subtract(bench.robot.tip_mm(), bench.robot.direction()))
    )
    along = (tip_px - behind_px) / norm(tip_px - behind_px)
    y, x = np.mgrid[: image.shape[0], : image.shape[1]]
    to_tip_mm = ((tip_px[0] - x) * along[0] + (tip_px[1] - y) * along[1]) / bench.settings.px_per_mm
    share = np.clip(to_tip_mm / over_mm, 0, 1)[..., None]
    return np.rint(image * share + empty * (1 - share)).astype(np.uint8)


def test_detects_no_needle_in_many_images_without_one(bench):
    for number in range(20):
        assert "needle_tip" not in bench.observe(bench.image(-12.0, 0.0, number), number).found


def test_tracks_a_fast_needle_without_lag(bench):
    for number in range(24):
        observation = bench.observe(bench.image(4.0 + 0.66 * number, 0.0, number), number)  # 20 mm/s
        assert error_px(bench, observation) < 1.5


def test_standard_deviations_are_about_as_large_as_the_errors(bench):
    errors, sds_deg = [], []
    for number, depth_mm in enumerate(np.linspace(3, 20, 40)):
        observation = bench.observe(bench.image(float(depth_mm), 2.0, number), number)
        errors.append(turn_deg(bench, observation))
        sds_deg.append(observation.certainty.theta_sd_deg)
        assert 0.4 <= observation.certainty.confidence <= 1
    assert np.median(errors) < 3 * np.median(sds_deg)
    assert np.median(sds_deg) < 0.2


def test_flickering_light_does_not_move_the_needle(bench):
    bench.follow([8.0, 8.1, 8.2])
    image = bench.image(8.3, 0.0, 3)
    dim = np.clip(image * 0.8, 0, 255).astype(np.uint8)
    assert error_px(bench, bench.observe(dim, 3)) < 1.5


def test_the_same_images_give_the_same_observations(bench):
    first = bench.follow(INWARDS, 2.0)
    bench.perceive.reset()
    assert bench.follow(INWARDS, 2.0) == first


def test_grey_images_are_as_good(bench):
    image = bench.image(12.0, 0.0)
    grey = bench.observe(np.ascontiguousarray(image[:, :, 1]))
    assert error_px(bench, grey) < 2.0


def test_refuses_an_image_of_another_size(bench):
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
def test_refuses_an_image_of_another_kind(bench, image, found):
    with pytest.raises(BadInput, match=f"expected an image of 8 bits, grey or BGR, found {found}"):
        bench.observe(image)


def test_the_angle_has_little_noise_with_a_short_shaft_inside(bench):
    depths = [*np.arange(-3.0, 2.0, 0.25), *[2.0] * 20]
    held = bench.follow([float(depth) for depth in depths], 3.0)[-15:]
    angles = [
        math.degrees(math.atan2(*subtract(line.end_mm, line.start_mm)))
        for line in (observation.found["needle_line"] for observation in held)
    ]
    assert np.std(angles) < 0.3


def test_whatever_an_image_shows_the_tracker_neither_fails_nor_reports_nonsense(bench):
    rng = np.random.default_rng(0)
    for number in range(40):
        image = bench.image(float(rng.uniform(-5, 22)), float(rng.uniform(-20, 20)), number)
        nuisance = [
            rng.integers(0, 256, image.shape, np.uint8),
            np.full_like(image, rng.integers(256)),
            np.ascontiguousarray(image[::-1]),
            np.clip(image * rng.uniform(0, 4), 0, 255).astype(np.uint8),
            image,
        ]
        observation = bench.observe(nuisance[number % len(nuisance)], number)
        tip, certainty = observation.found.get("needle_tip"), observation.certainty
        line = observation.found.get("needle_line")
        assert (line is None) == (certainty is None)
        assert (tip is None) == (certainty is None or certainty.tip_sd_mm is None)
        if line is not None:
            assert all(norm(end_mm) < 40 for end_mm in (line.start_mm, line.end_mm))
            assert 0 < certainty.theta_sd_deg < 90
        if tip is not None:
            assert norm(tip.at_mm) < 40
            assert 0 < certainty.tip_sd_mm < 10
