import numpy as np
import pytest
from msgspec.structs import replace
from robot_runs import TARGET_MM, random_transform, simulated_run

from haptigraph.errors import BadInput
from haptigraph.robot.place.autocorrelation import values_per_independent
from haptigraph.robot.place.calibration import (
    calibrate_points,
    calibrate_section,
    leave_one_out_mm,
    pose_noise_mm,
    setup_text,
)
from haptigraph.robot.setup import MotionLimits, RcmPlace, RobotSetup, parse_setup


def tracked(seed, **given):
    run = simulated_run(np.random.default_rng(seed), seconds=12, **given)
    base_mm = np.column_stack([np.interp(run.image_s, run.robot_s, column) for column in run.robot_mm.T])
    return run, base_mm


def test_a_tracked_motion_places_the_eye():
    run, base_mm = tracked(1)
    found = calibrate_section(base_mm, run.image_mm, np.full(len(base_mm), 0.02), 0.01, TARGET_MM, "run.mcap")
    error_mm = found.fit.eye_from_base.point_mm(run.eye_from_base.inverse().point_mm(TARGET_MM)) - TARGET_MM
    assert np.abs(error_mm[:2]).max() < 4 * found.tip_sd_mm < 0.3
    assert any("section" in note for note in found.notes) and any(
        "left-handed" in note for note in found.notes
    )


def test_residuals_that_the_tracker_does_not_explain_are_the_robots():
    run, base_mm = tracked(8, tracker_sd_mm=0.05)
    found = {
        stated_mm: calibrate_section(
            base_mm, run.image_mm, np.full(len(base_mm), stated_mm), 0.01, TARGET_MM, "run.mcap"
        )
        for stated_mm in (0.2, 0.05, 0.01)
    }
    assert found[0.2].pose_sd_mm == 0.01
    assert 0.01 <= found[0.05].pose_sd_mm < 0.03 < found[0.01].pose_sd_mm < 0.06
    assert found[0.01].tip_sd_mm == pytest.approx(np.hypot(found[0.01].target_sd_mm, found[0.01].pose_sd_mm))
    assert found[0.01].axes == 2 and found[0.2].target_sd_mm == pytest.approx(
        found[0.2].fit.sd_at_mm(TARGET_MM, axes=2)
    )


@pytest.mark.parametrize("jitter_s, most_mm", [(0.0, 0.011), (0.002, 0.015)])
def test_the_noise_of_poses_is_measured_beside_their_motion(jitter_s, most_mm):
    run = simulated_run(np.random.default_rng(9), jitter_s=jitter_s)
    assert 0.009 < pose_noise_mm(run.robot_s, run.robot_mm) < most_mm


def test_a_motion_out_of_the_section_is_refused():
    run, base_mm = tracked(2)
    normal = run.eye_from_base.rotation[2]
    base_mm += np.outer(2 * np.sin(run.image_s), normal)
    with pytest.raises(BadInput, match=r"leaves its plane by [01]\.\d+ mm"):
        calibrate_section(base_mm, run.image_mm, np.full(len(base_mm), 0.02), 0.01, TARGET_MM, "run.mcap")


def test_leaving_out_a_point_moves_it_by_more_than_its_residual():
    rng = np.random.default_rng(3)
    eye_mm = rng.uniform(-9, 9, (6, 3))
    base_mm = random_transform(rng).inverse().point_mm(eye_mm) + rng.normal(0, 0.1, eye_mm.shape)
    found = calibrate_points(base_mm, eye_mm, 0.1, TARGET_MM, "touched.csv")
    left_out = leave_one_out_mm(base_mm, eye_mm, found.fit)
    assert (left_out > np.linalg.norm(found.fit.residual_mm, axis=1)).all()


def test_the_text_is_a_setup_that_keeps_earlier_limits():
    rng = np.random.default_rng(4)
    eye_mm = rng.uniform(-9, 9, (6, 3))
    found = calibrate_points(random_transform(rng).inverse().point_mm(eye_mm), eye_mm, 0.1, TARGET_MM, "x")
    rcm = RcmPlace((1.0, 2.0, 3.0), 0.05)
    earlier = RobotSetup(rcm, limits=MotionLimits(speed_mm_s=3.0, force_n=0.5))
    setup = parse_setup(setup_text(found.eye, rcm, earlier, "-x", "Title.", ("note",)), "robot.toml")
    assert setup.rcm == rcm and setup.limits == earlier.limits and setup.shaft_axis == "-x"
    moved = setup.eye.robot_from_eye.inverse().point_mm(found.fit.eye_from_base.inverse().point_mm(eye_mm))
    np.testing.assert_allclose(moved, eye_mm, atol=1e-5)
    assert replace(setup.eye, residual_rms_mm=None).tip_sd_mm == pytest.approx(found.tip_sd_mm, rel=1e-3)


def test_correlated_errors_are_worth_fewer_values():
    rng = np.random.default_rng(5)
    white = rng.normal(size=4000)
    slow = np.convolve(white, np.ones(20), mode="valid")
    assert values_per_independent(white) < 1.5
    assert 14 < values_per_independent(slow) < 28
    assert values_per_independent(np.zeros(50)) == 1.0
