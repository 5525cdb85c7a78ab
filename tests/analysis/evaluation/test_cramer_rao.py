import numpy as np
import pytest
from msgspec.structs import replace

from haptigraph.analysis.evaluation.cramer_rao import angle_bound
from haptigraph.geometry import rotate, unit
from haptigraph.sim.eye.camera import Camera
from haptigraph.sim.eye.eye import Eye, EyeShape
from haptigraph.sim.eye.needle import NeedleShape
from haptigraph.sim.eye.optics import CameraSettings
from haptigraph.sim.eye.palette import Appearance
from haptigraph.sim.robot.robot import Pose

EYE = Eye(EyeShape())
SMALL = CameraSettings(
    width_px=360,
    height_px=216,
    center_px=(180.0, 120.0),
    px_per_mm=7.0,
    read_noise_grey=4.0,
    shot_noise_grey=0.0,
    shadow=0.0,
)
POSE = Pose(8.0, 4.0)


def camera(**settings):
    return Camera(EYE, replace(SMALL, **settings), NeedleShape(taper_mm=3.0), Appearance(), 2)


def bound(pose=POSE, **settings):
    return angle_bound(camera(**settings), EYE, pose)


def test_half_the_noise_halves_every_bound():
    whole, half = bound(), bound(read_noise_grey=2.0)
    for name in whole.__struct_fields__:
        assert getattr(half, name) == pytest.approx(getattr(whole, name) / 2, rel=1e-5)


def test_the_bound_decreases_with_depth():
    bounds = [bound(Pose(depth_mm, 4.0)).inside_deg for depth_mm in (3.0, 5.0, 9.0, 16.0)]
    assert bounds == sorted(bounds, reverse=True)


def test_more_information_lowers_the_bound():
    bounds = bound(Pose(4.0, 4.0))
    assert bounds.both_deg < bounds.inside_deg < bounds.inside_rcm_free_deg
    assert bounds.both_deg < bounds.both_rcm_free_deg < bounds.inside_rcm_free_deg


def test_a_needle_outside_carries_no_information_inside():
    assert bound(Pose(-2.0, 4.0)).inside_deg == float("inf")


def test_maximum_likelihood_estimates_reach_the_bound():
    """The most likely (angle, depth) of many noisy images, by grid search over the inside."""
    lens = camera()
    limit_deg = angle_bound(lens, EYE, POSE).inside_deg
    y, x = np.mgrid[: SMALL.height_px, : SMALL.width_px]
    counted = np.hypot(x - SMALL.center_px[0], y - SMALL.center_px[1]) < 12 * 7.0

    def tip_and_direction(angle_deg, depth_step_mm):
        tx, ty = EYE.trocar_mm
        along = rotate(unit((-tx, -ty)), POSE.pitch_deg + angle_deg)
        depth_mm = POSE.depth_mm + depth_step_mm
        return (tx + depth_mm * along[0], ty + depth_mm * along[1]), along

    angles, depths = np.linspace(-0.6, 0.6, 9), np.linspace(-0.12, 0.12, 5)
    grid = [(angle, depth) for angle in angles for depth in depths]
    expected = np.array([lens.expect(*tip_and_direction(*node))[0][counted] for node in grid], np.float64)
    grey, noise_sd = lens.expect(*tip_and_direction(0, 0))
    rng = np.random.default_rng(1)
    # chi2 is quadratic near its minimum: fit it over the grid, and take the minimum of the fit.
    a, b = np.array(grid).T
    terms = np.stack([np.ones_like(a), a, b, a * a, a * b, b * b], axis=1)
    found_deg = []
    for _ in range(200):
        noisy = grey[counted] + noise_sd[counted] * rng.standard_normal(counted.sum())
        chi2 = (((noisy - expected) / noise_sd[counted]) ** 2).sum(axis=1)
        _, slope_a, slope_b, aa, ab, bb = np.linalg.lstsq(terms, chi2, rcond=None)[0]
        found_deg.append(np.linalg.solve([[2 * aa, ab], [ab, 2 * bb]], [-slope_a, -slope_b])[0])
    assert np.std(found_deg) == pytest.approx(limit_deg, rel=0.25)
