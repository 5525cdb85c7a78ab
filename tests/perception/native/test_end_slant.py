"""Slant and curve of ends that are drawn: cut straight across, obliquely, round and tapered."""

import numpy as np
import pytest
from drawn_strip import END_PX, HALF_PX, STATION_PX, U_PX, blurred, strip
from msgspec.structs import replace

from haptigraph.perception.native.strip import end_slant

WIDTH_PX, SLANT = 10.0, 1.2
LINE = 0.7, 0.004  # of the shaft's middle
ACROSS_PX = np.arange(-HALF_PX, HALF_PX + 1)[:, None] - LINE[0] - LINE[1] * U_PX
X = ACROSS_PX / (WIDTH_PX / 2)
ROUND = np.sqrt(np.maximum(1 - X**2, 0))
LIT = 40.0 * (1 + 0.6 * X)  # from one side


def drawn(ends_px, noise_grey=0.0, blur_px=0.8, seed=0):
    """A strip with a shaft each of whose lanes ends somewhere."""
    covered = np.clip(WIDTH_PX / 2 + 0.5 - abs(ACROSS_PX), 0, 1)
    ends = np.clip((ends_px - U_PX) / STATION_PX + 0.5, 0, 1)
    excess = blurred(covered * ends * LIT, blur_px, STATION_PX)
    noise = np.random.default_rng(seed).normal(0, noise_grey, (2, *excess.shape))
    return replace(strip(excess), planes=(excess + noise).astype(np.float32), noise_grey=noise_grey)


def cut(side, roll_deg=0.0):
    """Where a plane cuts the shaft, its tip at END_PX: to one side, 1 or -1, and rolled towards the camera."""
    cosine, sine = np.cos(np.radians(roll_deg)), np.sin(np.radians(roll_deg))
    return END_PX - WIDTH_PX * SLANT / 2 * (1 - side * cosine * np.clip(X, -1, 1) - sine * ROUND)


def found(ends_px, **options):
    return end_slant(drawn(ends_px, **options), LINE, END_PX, WIDTH_PX)


@pytest.mark.parametrize("side", [-1, 1])
@pytest.mark.parametrize("blur_px", [0.5, 1.0])
def test_an_oblique_cut_has_its_slant_however_it_is_lit_and_blurred(side, blur_px):
    slant, curve, sd = found(cut(side), blur_px=blur_px)
    assert slant == pytest.approx(side * SLANT, abs=0.15)
    assert abs(curve) < 0.15 and sd < 0.2


def test_an_oblique_cut_that_faces_the_camera_more_has_a_curve_for_its_slant():
    slant, curve, _ = found(cut(1, roll_deg=40))
    assert slant == pytest.approx(SLANT * np.cos(np.radians(40)), abs=0.2)
    assert curve == pytest.approx(SLANT / 2 * np.sin(np.radians(40)), abs=0.15)


@pytest.mark.parametrize(
    ("ends_px", "curved"),
    [
        (np.full_like(X, END_PX), False),
        (END_PX - WIDTH_PX / 2 * (1 - ROUND), True),
        (END_PX - 2 * WIDTH_PX * abs(X), True),
    ],
    ids=["blunt", "round", "cone"],
)
def test_an_end_that_is_the_same_on_both_sides_has_no_slant(ends_px, curved):
    slant, curve, _ = found(ends_px)
    assert abs(slant) < max(0.15, 0.2 * curve)
    assert (curve > 0.3) == curved


def test_noise_makes_the_slant_as_uncertain_as_it_is():
    noisy = [found(cut(1), noise_grey=6.0, seed=seed) for seed in range(60)]
    slants, _, sds = zip(*noisy, strict=True)
    assert np.mean(slants) == pytest.approx(found(cut(1))[0], abs=0.15)
    assert np.std(slants) == pytest.approx(np.median(sds), rel=0.4)


def test_a_shaft_of_which_too_little_shows_has_none():
    shown = drawn(cut(1))
    assert end_slant(shown, LINE, float(U_PX[shown.inside.start]) + 10, WIDTH_PX) is None
    assert end_slant(shown, LINE, END_PX, 0.5) is None
    assert end_slant(shown, (1e6, 0.0), END_PX, WIDTH_PX) is None
