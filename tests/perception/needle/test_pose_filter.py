import math

import pytest

from haptigraph.perception.needle.pose_filter import PoseFilter
from haptigraph.perception.needle.rectify import Line

SHARP = (0.01, 0.0, 1e-8)
SHALLOW = (4.0, -0.039, 0.0004)  # 20 px of shaft, 100 px from the trocar
STEP_S = 1 / 30


def hold(pose: PoseFilter, covariance, images: int, angle_rad: float = 1.5, offset_px: float = 0.0):
    for number in range(images):
        if number:
            pose.predict(STEP_S)
        pose.update(Line(angle_rad, offset_px), covariance, 100.0, 0.1, is_in_trocar=True)


def test_follows_a_sharp_measurement_without_lag():
    pose = PoseFilter(20.0)
    hold(pose, SHARP, 3)
    pose.predict(STEP_S)
    pose.update(Line(1.52, 0.0), SHARP, 113.0, 0.1, is_in_trocar=True)
    assert pose.line.angle_rad == pytest.approx(1.52, abs=2e-4)
    assert pose.depth_px == pytest.approx(113.0, abs=0.1)


def test_soon_predicts_a_needle_held_still_after_a_sudden_move():
    pose = PoseFilter(20.0)
    hold(pose, SHARP, 5)
    expected = []
    for _ in range(8):
        expected.append(pose.predict(STEP_S))
        pose.update(Line(1.6, 0.0), SHARP, 360.0, 0.1, is_in_trocar=True)
    for line, depth_px in expected[5:]:
        assert depth_px == pytest.approx(360.0, abs=10.0)
        assert line.angle_rad == pytest.approx(1.6, abs=0.01)


def test_knowing_the_rcm_sharpens_the_angle_of_a_short_shaft():
    fresh, knowing = PoseFilter(20.0), PoseFilter(20.0)
    hold(knowing, SHARP, 30)
    knowing.lose()
    for pose in (fresh, knowing):
        pose.update(Line(1.5, 0.0), SHALLOW, 120.0, 0.1, is_in_trocar=True)
    assert knowing.angle_sd_rad < 0.8 * math.sqrt(SHALLOW[2])
    assert knowing.angle_sd_rad < fresh.angle_sd_rad


def test_losing_the_needle_keeps_the_rcm_and_reset_forgets_it():
    pose = PoseFilter(20.0)
    hold(pose, SHARP, 30, offset_px=2.0)
    pose.lose()
    assert not pose.is_tracking
    pose.update(Line(1.5, 2.0), SHALLOW, 120.0, 0.1, is_in_trocar=True)
    assert pose.line.offset_px == pytest.approx(2.0, abs=0.2)
    pose.reset()
    assert pose.line.offset_px == 0.0


def test_a_needle_outside_need_not_pass_the_trocar():
    pose = PoseFilter(20.0)
    pose.update(Line(1.5, 15.0), SHARP, -60.0, 0.1, is_in_trocar=False)
    assert pose.line.offset_px == 15.0


def test_what_is_alike_in_all_images_does_not_average_out():
    pose = PoseFilter(20.0)
    hold(pose, SHARP, 50)
    assert pose.tip_sd_px(3.0) == pytest.approx(3.0, abs=0.1)
    assert pose.tip_sd_px(0.001) == pose.tip_sd_px() < 1.0


def test_uncertainty_grows_without_measurements():
    pose = PoseFilter(20.0)
    hold(pose, SHARP, 10)
    before = pose.angle_sd_rad, pose.tip_sd_px()
    pose.predict(0.1)
    assert pose.angle_sd_rad > before[0]
    assert pose.tip_sd_px() > before[1]
