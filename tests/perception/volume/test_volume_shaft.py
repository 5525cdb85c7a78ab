"""Needle and surfaces in simulated volumes with ground truth."""

import math
from functools import cache

import numpy as np
import pytest
from msgspec.structs import replace
from volume_gap import gap_to

from haptigraph.perception.volume.scale import VolumeScale
from haptigraph.perception.volume.shaft import find_needle_and_surfaces
from haptigraph.perception.volume.surfaces import HeightMap
from haptigraph.sim.oct.volumes.scenes import random_volume_scene

SHAPE, SEED = (224, 36, 144), 77
NEEDLES, EMPTY = [0, 1, 2, 3, 4, 6, 7, 8, 9, 10], [5, 11, 17]


def scale_of(truth):
    return VolumeScale(*truth.grid.shape, *truth.grid.voxel_mm)


def found_in(volume):
    scale = scale_of(volume.truth)
    return find_needle_and_surfaces(volume.image.reshape(scale.shape), scale)


@cache
def taken(number):
    """A volume, its scene and what is found."""
    scene = random_volume_scene(number, SEED, shape=SHAPE)
    volume = scene.take()
    return scene, volume.truth, found_in(volume)


def at_cells(array, truth, surface):
    return np.stack([np.interp(surface.x_mm, truth.grid.x_mm, row) for row in array.astype(float)])


@pytest.mark.parametrize("name", ["ilm", "rpe"])
def test_surfaces_agree_with_the_truth_and_their_uncertainty_is_true(name):
    z, hidden = [], []
    for number in (0, 3, 5, 8):
        _, truth, found = taken(number)
        surface = getattr(found, name)
        true = at_cells(getattr(truth, f"{name}_mm"), truth, surface)
        lit = at_cells(getattr(truth, f"{name}_lit"), truth, surface)
        inside = np.abs(true) < truth.grid.y_mm[0] - 0.08
        off = surface.height_mm - true
        visible = surface.visible & (lit > 0.99) & inside
        assert visible.sum() > 0.85 * ((lit > 0.99) & inside).sum()
        assert np.percentile(np.abs(off[visible]), 95) < 0.014
        z.append(off[visible] / surface.sd_mm[visible])
        hidden.append((off / surface.sd_mm)[(lit < 0.01) & inside])
    assert 0.5 < np.percentile(np.abs(np.concatenate(z)), 68.3) < 1.5
    assert np.percentile(np.abs(np.concatenate(hidden)), 95) < 3.5


def test_in_the_shadow_of_a_needle_a_surface_is_interpolated_not_visible():
    seen, covered = 0, 0
    for number in (0, 3, 8):
        _, truth, found = taken(number)
        dark = at_cells(~truth.rpe_lit, truth, found.rpe) > 0.99
        covered += dark.sum()
        seen += (found.rpe.visible & dark).sum()
        if dark.any():
            assert found.rpe.sd_mm[dark].mean() > found.rpe.sd_mm[found.rpe.visible].mean()
    assert covered > 30
    assert seen < 0.35 * covered


def test_needles_are_found_with_tip_axis_and_gap():
    errors, gaps, angles, known = [], [], [], 0
    for number in NEEDLES:
        scene, truth, found = taken(number)
        needle, true = found.needle, truth.needle
        if needle is None or needle.tip_mm is None:
            continue
        known += 1
        errors.append(needle.tip_mm - true.tip_mm)
        gap = gap_to(found.rpe, needle.tip_mm, needle.tip_cov_mm2)
        gaps.append(gap.gap_mm - truth.gap_mm)
        angles.append(math.degrees(math.acos(min(needle.along @ true.along, 1.0))))
        assert needle.radius_mm == pytest.approx(scene.needle.diameter_mm / 2, abs=0.01)
        assert np.abs(errors[-1] / needle.tip_sd_mm).max() < 6
        assert gap.sd_mm > 0
    assert known >= 0.6 * len(NEEDLES)
    assert np.median(np.linalg.norm(errors, axis=1)) < 0.02
    assert np.linalg.norm(errors, axis=1).max() < 0.1
    assert np.median(np.abs(gaps)) < 0.015
    assert np.median(angles) < 1.0


def test_the_side_to_which_the_bevel_opens_is_stated_only_if_it_is_right():
    stated = 0
    for number in NEEDLES:
        _, truth, found = taken(number)
        if found.needle is not None and found.needle.facing is not None:
            stated += 1
            assert found.needle.facing @ truth.needle.facing > 0.6
    assert stated >= 5


def test_in_volumes_without_a_needle_none_is_found():
    assert [taken(number)[2].needle for number in EMPTY] == [None] * len(EMPTY)


def test_the_same_volume_gives_the_same_digits():
    scene, _, found = taken(3)
    again = found_in(scene.take())
    assert np.array_equal(found.needle.tip_cov_mm2, again.needle.tip_cov_mm2)
    assert np.array_equal(found.rpe.height_mm, again.rpe.height_mm)


def test_a_tip_outside_the_volume_is_not_reported():
    scene = random_volume_scene(6, SEED, shape=SHAPE, place="above")
    half_mm = scene.scan.width_px * scene.scan.lateral_mm_per_px / 2
    scene = replace(scene, tip_x_mm=half_mm + 0.2, tip_z_mm=0.0, turn_deg=0.0)
    needle = found_in(scene.take()).needle
    assert needle is None or needle.tip_mm is None


def test_a_bright_line_without_a_shadow_is_no_needle():
    scene = random_volume_scene(5, SEED, shape=SHAPE)
    volume = scene.take()
    cube = volume.image.reshape(SHAPE).copy()
    for step in range(80):
        cube[40 + step // 2 : 43 + step // 2, 16:19, step] = 255
    assert find_needle_and_surfaces(cube, scale_of(volume.truth)).needle is None


def test_noise_alone_has_no_needle_and_no_visible_surface():
    noise = np.random.default_rng(1).normal(60, 30, SHAPE).clip(0, 255).astype(np.uint8)
    found = find_needle_and_surfaces(noise, VolumeScale(*SHAPE, 0.007, 0.06, 0.016))
    assert found.needle is None
    assert found.rpe.visible.mean() < 0.1


def test_a_gap_is_measured_along_the_local_normal_with_its_uncertainty():
    x, z = np.linspace(-1, 1, 41), np.linspace(-1, 1, 21)
    slope = math.tan(math.radians(30))
    height = slope * np.broadcast_to(x, (21, 41))
    surface = HeightMap(x, z, height, np.ones((21, 41), bool), np.full((21, 41), 0.004))
    gap = gap_to(surface, np.array([0.1, 0.1 * slope + 0.2, 0.3]), np.diag([0.01, 0.02, 0.03]) ** 2)
    assert gap.gap_mm == pytest.approx(0.2 * math.cos(math.radians(30)))
    tip_sd = math.hypot(0.01 * math.sin(math.radians(30)), 0.02 * math.cos(math.radians(30)))
    assert gap.sd_mm == pytest.approx(math.hypot(tip_sd, 0.004 * math.cos(math.radians(30))))
    assert gap.is_visible
