"""Simulated volumes: geometry of needle and shadow, the retina in both directions, and the phantom."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

from haptigraph.errors import BadInput
from haptigraph.geometry import Polyline, height_on_polyline
from haptigraph.sim.oct.phantom import open_phantom
from haptigraph.sim.oct.retina import RetinaShape
from haptigraph.sim.oct.scenes import PLACES
from haptigraph.sim.oct.volumes.needle import VolumeNeedle, pose, upper_mm
from haptigraph.sim.oct.volumes.phantom import VolumePhantom, load_volume_scenario
from haptigraph.sim.oct.volumes.retina import VolumeRetina
from haptigraph.sim.oct.volumes.scenes import random_volume_scene
from haptigraph.toml_document import Document

SMALL = 96, 16, 64
X_MM, Z_MM = np.linspace(-1, 1, 81), np.linspace(-1, 1, 61)
STATIC = RetinaShape(breathing_mm=0, heartbeat_mm=0, waves_mm=0, tilt_deg=0)
QUICK = """
[scenario]
description = "quick"
seed = 3
rate_hz = 4
[scan]
width_px = 64
height_px = 96
axial_mm_per_px = 0.017
lateral_mm_per_px = 0.035
[volume]
slices = 12
slice_mm = 0.18
[[move]]
duration_s = 0.5
depth_mm = -0.4
theta_deg = 0.0
[[move]]
duration_s = 1.0
depth_mm = 0.3
theta_deg = 0.0
[[move]]
duration_s = 0.5
depth_mm = 0.3
theta_deg = 0.0
away = true
"""


def quick_phantom():
    return VolumePhantom(load_volume_scenario(Document(QUICK, "quick.toml")))


# --- the needle

angles = {"lean": st.floats(15, 60), "turn": st.floats(-180, 180), "roll": st.floats(-180, 180)}


@given(**angles)
def test_the_metal_is_within_a_radius_of_the_axis_and_never_beyond_the_tip(lean, turn, roll):
    shape = VolumeNeedle(bevel_deg=25.0)
    needle = pose(np.array([0.1, 0.2, -0.1]), lean, turn, roll)
    x, z = np.meshgrid(np.linspace(-1, 1, 161), np.linspace(-1, 1, 161))
    tops, _ = upper_mm(needle, shape, x, z)
    metal = np.isfinite(tops)
    assert metal.any()
    off = np.stack([x[metal], tops[metal], z[metal]], axis=1) - needle.axis_mm(shape.diameter_mm)
    along = off @ needle.along
    across = np.linalg.norm(off - along[:, None] * needle.along, axis=1)
    assert across.max() <= shape.diameter_mm / 2 + 1e-9
    assert along.max() <= 1e-9


@given(**angles)
def test_a_pose_has_the_angles_it_is_made_from(lean, turn, roll):
    needle = pose(np.zeros(3), lean, turn, roll)
    assert math.degrees(math.asin(-needle.along[1])) == pytest.approx(lean)
    assert np.linalg.norm(needle.along) == pytest.approx(1)
    assert needle.along @ needle.facing == pytest.approx(0, abs=1e-12)
    assert needle.facing[1] == pytest.approx(math.cos(math.radians(roll)) * math.cos(math.radians(lean)))


def test_a_bevel_that_faces_up_shows_a_face_that_slopes_down_to_the_tip():
    shape, x = VolumeNeedle(bevel_deg=20.0), np.linspace(-1.0, 0.0, 400)
    up, down = (
        upper_mm(pose(np.zeros(3), 30.0, 0.0, roll), shape, x, np.zeros(400))[0] for roll in (0.0, 180.0)
    )
    assert up[np.isfinite(up)][-1] == pytest.approx(0.0, abs=0.01)
    slopes = np.diff(up[np.isfinite(up)]) / np.diff(x)[0]
    assert slopes[0] == pytest.approx(-math.tan(math.radians(30)), abs=1e-6)
    assert slopes[-1] == pytest.approx(-math.tan(math.radians(50)), abs=1e-6)
    straight = np.diff(down[np.isfinite(down)]) / np.diff(x)[0]
    assert straight == pytest.approx(np.full(len(straight), -math.tan(math.radians(30))), abs=1e-6)


# --- the retina


def test_the_retina_is_curved_and_tilted_in_both_directions():
    retina = VolumeRetina(replace(STATIC, tilt_deg=5.0, radius_mm=12.0), 3.0, X_MM, Z_MM, 1)
    ilm = retina.heights(np.zeros(61)).ilm_mm
    for profile, along, tilt_deg in ((ilm[30], X_MM, 5.0), (ilm[:, 40], Z_MM, 3.0)):
        curve, slope, _ = np.polyfit(along, profile, 2)
        assert slope == pytest.approx(math.tan(math.radians(tilt_deg)), abs=1e-3)
        assert curve == pytest.approx(1 / 24, rel=0.02)


@given(st.floats(0.0, 0.25), st.floats(-0.7, 0.7), st.floats(-0.7, 0.7))
def test_before_puncture_the_ilm_is_at_the_tip_and_highest_far_away(depth_mm, x_mm, z_mm):
    retina = VolumeRetina(replace(STATIC, puncture_mm=0.3), 0.0, X_MM, Z_MM, 1)
    rest = float(retina.rest_mm(np.array(x_mm), np.array(z_mm)).ilm_mm)
    tip = np.array([x_mm, rest - depth_mm, z_mm])
    retina.press(0.1, tip, 0.0)
    assert not retina.is_pierced
    at_tip = retina.at_tip(tip, 0.0)
    assert at_tip.ilm_mm == pytest.approx(tip[1], abs=1e-9)
    heights, still = retina.heights(np.zeros(61)), retina.rest_mm(X_MM[None], Z_MM[:, None])
    dent = still.ilm_mm - heights.ilm_mm
    nearest = np.unravel_index(dent.argmax(), dent.shape)
    assert np.hypot(X_MM[nearest[1]] - x_mm, Z_MM[nearest[0]] - z_mm) < 0.03 or depth_mm < 1e-6
    assert still.rpe_mm - heights.rpe_mm == pytest.approx(STATIC.rpe_share * dent)


def test_slices_are_acquired_one_after_the_other():
    scene = random_volume_scene(0, 1, shape=SMALL, place="none")
    moving = replace(
        scene.retina, breathing_mm=0.08, breathing_hz=0.3, heartbeat_mm=0.0, waves_mm=0.0, tilt_deg=0.0
    )
    scene = replace(scene, retina=moving, volume=replace(scene.volume, jitter_mm=0.0, tilt_deg=0.0))
    slow, at_once = (
        scene.acquisition().advance(1.0, 0.0, duration_s, lambda _: None) for duration_s in (1.0, 0.0)
    )
    drift = (slow.ilm_mm - at_once.ilm_mm).mean(axis=1)
    assert drift[-1] == pytest.approx(0.0, abs=1e-9)
    assert np.ptp(drift) > 0.02
    assert np.ptp(slow.ilm_mm - at_once.ilm_mm, axis=1) == pytest.approx(np.zeros(16), abs=1e-9)


# --- volumes


def test_the_same_number_gives_the_same_volume():
    one, again = (random_volume_scene(4, 2, shape=SMALL).take() for _ in range(2))
    assert np.array_equal(one.image, again.image)
    assert not np.array_equal(one.image, random_volume_scene(4, 2, shape=SMALL).take(1).image)
    assert one.image.shape == (96, 16 * 64)


@pytest.mark.parametrize("place", PLACES)
def test_light_reaches_only_what_no_metal_covers(place):
    scene = random_volume_scene(3, 5, shape=(160, 24, 96), place=place)
    appearance = replace(
        scene.appearance, vessels=0, floaters=0, haze_db=-20.0, streaks=0, signal_db=0.0, vitreous_db=-20.0
    )
    volume = replace(scene, appearance=appearance).take()
    truth, (h, n, w) = volume.truth, scene.camera().grid.shape
    image = volume.image.reshape(h, n, w).astype(float)
    rows = np.rint((h - 1) / 2 - truth.rpe_mm / truth.grid.voxel_mm[0]).astype(int)
    band = np.mean(
        [np.take_along_axis(image, np.clip(rows + k, 0, h - 1)[None], axis=0)[0] for k in range(1, 5)],
        axis=0,
    )
    assert (truth.needle is None) == (place == "none")
    assert np.median(band[truth.rpe_lit]) > appearance.noise_grey + 60
    if place == "none":
        assert truth.rpe_lit.all()
    else:
        covered = ~truth.rpe_lit
        inner = covered & np.roll(covered, 2, axis=1) & np.roll(covered, -2, axis=1)
        assert inner.sum() > 10
        assert np.median(band[inner]) < appearance.noise_grey + 25
    assert truth.is_pierced == (place == "inside")


def test_the_gap_is_measured_along_the_normal():
    scene = random_volume_scene(1, 4, shape=SMALL, place="above")
    truth = scene.take().truth
    vertical = truth.needle.tip_mm[1] - truth.tip_rpe_mm
    assert truth.gap_mm == pytest.approx(vertical * truth.rpe_cosine)
    assert 0.9 < truth.rpe_cosine <= 1.0
    _, at, column = truth.grid.index(truth.needle.tip_mm)
    assert truth.rpe_mm[round(at), round(column)] == pytest.approx(truth.tip_rpe_mm, abs=0.03)


# --- the phantom


def test_a_phantom_of_volumes_plays_an_approach_and_repeats_it():
    phantom = quick_phantom()
    first = [phantom.advance() for _ in range(phantom.images)]
    assert phantom.advance() is None
    assert phantom.images == 8
    assert all(moment.image.shape == (96, 12 * 64) for moment in first)
    depths = [moment.truth.depth_mm for moment in first if moment.truth.visible]
    assert depths[0] == pytest.approx(-0.4 * math.sin(math.radians(35)), abs=0.1)
    assert max(depths) > 0.05
    assert not first[-1].truth.visible
    phantom.restart()
    again = [phantom.advance() for _ in range(phantom.images)]
    assert all(np.array_equal(a.image, b.image) for a, b in zip(first, again, strict=True))


def test_the_truth_of_a_phantom_is_in_the_slice_of_the_tip():
    phantom = quick_phantom()
    moment = phantom.advance(draws=False)
    truth = phantom.truth
    row, at, column = truth.grid.index(truth.needle.tip_mm)
    assert moment.image.shape == (1, 1, 3)
    assert moment.truth.tip_px[0] == pytest.approx(round(at) * 64 + column)
    assert moment.truth.tip_px[1] == pytest.approx(row)
    ilm = moment.truth.others["ilm"]
    assert isinstance(ilm, Polyline)
    above_mm = moment.truth.tip_mm[1] - height_on_polyline(moment.truth.tip_mm[0], ilm)
    assert above_mm == pytest.approx(-moment.truth.depth_mm, abs=0.03)


def test_the_shipped_scenario_pierces_the_retina_and_comes_too_near_the_rpe():
    phantom = open_phantom("volume_approach")
    assert isinstance(phantom, VolumePhantom)
    gaps, pierced = [], []
    while phantom.advance(draws=False) is not None:
        gaps.append(phantom.truth.gap_mm)
        pierced.append(phantom.truth.is_pierced)
    assert len(gaps) == phantom.images
    assert not pierced[0] and any(pierced) and not pierced[-1]
    assert gaps[0] > 0.5
    assert min(gaps) < 0.03


def test_a_registration_of_volumes_states_the_slices():
    text = Document(quick_phantom().registration, "registration").data
    assert text["volume"] == {"slices": 12, "slice_mm": 0.18}
    assert text["image"] == {"width": 64, "height": 96}


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("slices = 12", "slices = 1", "slices"),
        ("slice_mm = 0.18", "slice_m = 0.18", "slice_mm"),
        ("duration_s = 0.5", "duration_s = 0.0", "duration_s"),
    ],
)
def test_an_invalid_volume_scenario_is_refused(old, new, message):
    with pytest.raises(BadInput) as refused:
        load_volume_scenario(Document(QUICK.replace(old, new, 1), "s.toml"))
    assert message in str(refused.value)
    assert "s.toml" in str(refused.value)
