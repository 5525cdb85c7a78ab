"""Fitting a lens: its parameters, the truth of its uncertainty, and what does not determine it."""

import math

import numpy as np
import pytest
from msgspec.structs import replace
from sheet_views import LENS, SIZE_PX, good_views, view_of

from haptigraph.analysis.calibrating import calibration
from haptigraph.analysis.calibrating.calibration import calibrate
from haptigraph.errors import BadInput


def largest_error_px(lens) -> float:
    """Of corrected points, after the shift, scale and rotation that a registration compensates."""
    places = [(x, y) for x in range(20, 1280, 60) for y in range(20, 720, 60)]
    found, true = (np.array([complex(*each.undistorted(place)) for place in places]) for each in (lens, LENS))
    rows = np.stack([found, np.ones(len(found))], axis=1)
    return float(np.abs(rows @ np.linalg.lstsq(rows, true, rcond=None)[0] - true).max())


def test_a_lens_is_found_with_its_uncertainty():
    found = calibrate(good_views(np.random.default_rng(1)), SIZE_PX)
    assert found.views == 16 and found.coverage > 0.9
    assert found.rms_px == pytest.approx(0.14, abs=0.02)  # 0.1 px by axis
    for name in ("focal_px", "principal_px"):
        for value, true, sd in zip(
            *(getattr(lens, name) for lens in (found.lens, LENS, found.sd)), strict=True
        ):
            assert abs(value - true) < 4 * sd and 0.01 < sd < 3
    assert largest_error_px(found.lens) < 0.5


@pytest.mark.parametrize("seeds", [2, pytest.param(6, marks=pytest.mark.slow)])
def test_corrected_points_are_as_uncertain_as_stated(seeds):
    ratios = []
    for seed in range(seeds):
        lens = calibrate(good_views(np.random.default_rng((2, seed))), SIZE_PX).lens
        assert 0.02 < lens.sd_px < 0.5
        ratios.append(largest_error_px(lens) / lens.sd_px)
    assert 0.2 < np.median(ratios) < 2  # the worst place of each
    assert max(ratios) < 4


def test_a_view_blurred_by_motion_is_left_out():
    rng = np.random.default_rng(3)
    views = good_views(rng)
    blurred = good_views(rng, noise_px=3.0)[5]
    found = calibrate([*views, blurred], SIZE_PX)
    assert found.views == 16
    assert largest_error_px(found.lens) < 0.5


def test_views_that_do_not_determine_the_lens_are_refused():
    rng = np.random.default_rng(4)
    views = good_views(rng)
    with pytest.raises(BadInput, match="7 different positions, at least 8 are needed"):
        calibrate(views[:7], SIZE_PX)
    left = [view_of(LENS, (150, y), (20, 15), 30, rng) for y in np.linspace(100, 600, 10)]
    with pytest.raises(BadInput, match=r"covers \d+% of the image, at least 80% is needed; .*lower right"):
        calibrate(left, SIZE_PX)
    aims = [(x, y) for x in (150, 450, 830, 1130) for y in (110, 260, 460, 610)]
    level = [view_of(LENS, aim, (0, 0), rng.uniform(40, 60), rng) for aim in aims]
    with pytest.raises(BadInput, match="fewer than 4 views have a sheet that is tilted by 10 degrees"):
        calibrate(level, SIZE_PX)
    with pytest.raises(BadInput, match=r"corners are off by .* px \(RMS\), at most 0\.6 px is accepted"):
        calibrate(good_views(rng, noise_px=1.0), SIZE_PX)


def test_a_mirrored_picture_has_the_mirrored_lens():
    rng = np.random.default_rng(5)
    mirrored = [
        replace(
            view,
            points_px=np.array([1279, 0]) + view.points_px * (-1, 1),
            board_points=view.board_points * (-1, 1),
        )
        for view in good_views(rng)
    ]
    lens = calibrate(mirrored, SIZE_PX).lens
    assert lens.principal_px == pytest.approx((1279 - 648, 352), abs=1.0)
    assert math.copysign(1, lens.distortion[3]) == -math.copysign(1, LENS.distortion[3])


@pytest.mark.parametrize(
    "limit, problem",
    [
        ("MAX_SD_PX", "corrected points are uncertain by"),
        ("MAX_FOCAL_SD", "the focal length is uncertain by"),
    ],
)
def test_a_lens_that_is_too_uncertain_is_refused(monkeypatch, limit, problem):
    monkeypatch.setattr(calibration, limit, 1e-6)
    with pytest.raises(BadInput, match=problem):
        calibrate(good_views(np.random.default_rng(6)), SIZE_PX)
