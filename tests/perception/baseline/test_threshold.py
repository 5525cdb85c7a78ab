import numpy as np
import pytest
from eye_bench import SETTINGS, Bench

from haptigraph.config import PerceptionConfig
from haptigraph.errors import BadInput
from haptigraph.geometry import Point, Segment, angle_between_deg, norm, subtract
from haptigraph.messages import Capture
from haptigraph.perception.baseline.threshold import ThresholdPerceiver


@pytest.fixture(scope="module", params=["light", "dark"])
def bench(request):
    return Bench(request.param, alpha=1.0)


@pytest.mark.parametrize("depth_mm", [4.0, 10.0, 18.0, 21.6])
@pytest.mark.parametrize("theta_deg", [-6.0, 0.0, 5.0])
def test_dark_and_bright_needles_are_found_accurately(bench, depth_mm, theta_deg):
    found = bench.look(bench.image(depth_mm, theta_deg))
    tip, line = found["needle_tip"], found["needle_line"]
    assert isinstance(tip, Point) and isinstance(line, Segment)
    miss_px = norm(subtract(tip.at_mm, bench.robot.tip_mm())) * SETTINGS.px_per_mm
    assert miss_px < 1.5
    shaft = subtract(line.end_mm, line.start_mm)
    assert angle_between_deg(shaft, bench.robot.direction()) < (1.5 if depth_mm < 5 else 0.5)
    assert line.end_mm == tip.at_mm


@pytest.mark.parametrize("depth_mm", [-8.0, -2.0, 0.3])
def test_a_needle_outside_or_in_the_wall_is_not_found(bench, depth_mm):
    assert "needle_tip" not in bench.look(bench.image(depth_mm, 2.0))


def test_no_needle_is_detected_in_background_images(bench):
    for number in range(20):
        assert "needle_tip" not in bench.look(bench.image(-12.0, 0.0, number))


def test_a_background_image_still_has_its_anatomy(bench):
    assert set(bench.look(bench.image(-12.0, 0.0))) == set(bench.registration.anatomy)


@pytest.mark.parametrize(("style", "polarity"), [("light", "bright"), ("dark", "dark")])
def test_the_wrong_polarity_finds_no_needle_at_the_tip(style, polarity):
    bench = Bench(style, polarity=polarity, alpha=1.0)
    tip = bench.look(bench.image(15.0, 0.0)).get("needle_tip")
    assert tip is None or norm(subtract(tip.at_mm, bench.robot.tip_mm())) > 0.2


def test_grey_and_colour_images_give_the_same_result(bench):
    grey = bench.image(12.0, 1.0)[..., 1].copy()
    coloured = np.repeat(grey[..., None], 3, axis=2)
    assert bench.look(grey) == bench.look(coloured)


def test_the_same_image_gives_an_identical_result(bench):
    image = bench.image(12.0, 1.0)
    assert bench.look(image) == bench.look(image.copy())


def test_smoothing_restarts_after_the_needle_was_lost():
    bench = Bench("dark")
    perceive = ThresholdPerceiver(bench.registration, PerceptionConfig(alpha=0.2))
    raw = bench.look(bench.image(16.0, 0.0))["needle_tip"]

    def tip(depth_mm):
        return perceive(Capture(0, 0, bench.image(depth_mm, 0.0))).found.get("needle_tip")

    tip(8.0)
    assert norm(subtract(tip(16.0).at_mm, raw.at_mm)) > 5.0
    assert tip(-5.0) is None
    assert tip(16.0) == raw


def test_an_image_of_another_size_is_refused(bench):
    with pytest.raises(BadInput, match="image is 320 x 240 px, but the registration is for 640 x 360 px"):
        bench.look(np.zeros((240, 320, 3), np.uint8))


def test_the_stages_lead_to_what_is_found(bench):
    image = bench.image(12.0, 2.0)
    tip, stages = bench.look(image)["needle_tip"], bench.perceive.stages(image)
    end_mm = bench.registration.image.to_mm(tuple(stages.ends_px[1]))
    assert end_mm == pytest.approx(tip.at_mm)
    left, top = stages.corner_px
    columns, rows = (stages.contour_px - np.array([left, top])).T
    assert stages.is_over[rows, columns].all()
    assert (np.abs(stages.above_mean[rows, columns]) > PerceptionConfig().offset_grey).all()


def test_without_a_needle_there_is_neither_contour_nor_line(bench):
    stages = bench.perceive.stages(bench.image(-12.0, 0.0))
    assert stages.contour_px is None and stages.ends_px is None
