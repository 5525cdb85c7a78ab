"""Simulated B-scans: speckle statistics, the needle's shadow, and the deformable retina."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

from haptigraph.sim.oct.appearance import EXPONENTIAL_DB, BscanAppearance, FieldBank, grey_from_power
from haptigraph.sim.oct.bscan import CLASSES, BscanCamera, ScanSettings
from haptigraph.sim.oct.needle import BscanNeedle
from haptigraph.sim.oct.retina import Retina, RetinaShape
from haptigraph.sim.oct.scenes import PLACES, random_bscan, random_scene

X_MM = np.linspace(-2, 2, 401)
STATIC = RetinaShape(breathing_mm=0, heartbeat_mm=0, waves_mm=0, tilt_deg=0)
PLAIN = BscanAppearance(vessels=0, floaters=0, vitreous_db=-20)


def decibels(image, appearance):
    return (image.astype(float) - appearance.noise_grey) / appearance.grey_per_db


@pytest.mark.parametrize("field", [0, 1], ids=["speckle", "noise"])
def test_fully_developed_speckle_is_exponential_in_intensity(field):
    """Its logarithm has an SD of 5.57 dB for any mean; its amplitude is Rayleigh distributed."""
    appearance = BscanAppearance(lateral_grain_px=1.0, grey_per_db=2.5, noise_grey=110.0)
    part = FieldBank((256, 256), appearance, 1).cut(np.random.default_rng(2))[field]
    intensity = (part**2).sum(axis=0)
    assert intensity.mean() == pytest.approx(1.0, abs=0.05)
    assert intensity.std() == pytest.approx(intensity.mean(), rel=0.06)
    assert np.mean(intensity > 2) == pytest.approx(np.exp(-2), abs=0.02)
    amplitude = np.sqrt(intensity)
    assert amplitude.std() / amplitude.mean() == pytest.approx(np.sqrt(4 / np.pi - 1), rel=0.04)
    for strength in (1.0, 300.0):
        grey = grey_from_power(np.float32(strength) * intensity, appearance)
        shown = decibels(grey, appearance)
        assert shown.std() == pytest.approx(5.57, abs=0.4)
    assert 10 * np.log10(intensity).mean() == pytest.approx(EXPONENTIAL_DB, abs=0.3)


def test_speckle_has_grains_and_noise_has_none():
    grains, noise = FieldBank((200, 200), BscanAppearance(lateral_grain_px=1.5), 3).cut(
        np.random.default_rng(1)
    )

    def neighbours(field):
        return float((field[:, :, 1:] * field[:, :, :-1]).mean() / (field**2).mean())

    assert neighbours(grains) > 0.7
    assert abs(neighbours(noise)) < 0.02


def scan_of(place="above", **fixed):
    scene = random_scene(1, 2, place=place, **fixed)
    camera = scene.camera()
    return camera, scene.take(camera)


def test_the_same_number_gives_the_same_image():
    one, other = random_bscan(4, 2), random_bscan(4, 2)
    assert np.array_equal(one.image, other.image)
    assert one.truth.needle == other.truth.needle
    assert not np.array_equal(one.image, random_bscan(5, 2).image)


@pytest.mark.parametrize("place", PLACES)
def test_the_image_changes_at_the_true_surface(place):
    _, scan = scan_of(place, haze_db=-20.0, floaters=0, columns=0, streaks=0, signal_db=0.0, vessels=0)
    truth, image = scan.truth, scan.image.astype(float)
    columns = np.flatnonzero(truth.ilm_lit & (truth.ilm_px > 30) & (truth.ilm_px < 480))
    assert (truth.needle is None) == (place == "none")
    rows = np.rint(truth.ilm_px[columns]).astype(int)
    step = np.mean([image[rows + k, columns] - image[rows - k, columns] for k in range(4, 12)])
    assert step > 40
    assert truth.is_pierced == (place == "inside")


def test_the_needles_shadow_contains_only_noise():
    camera, scan = scan_of("above", ghost_db=60.0, streaks=0, columns=0, floaters=0, haze_db=-20.0, looks=1)
    classes = camera.classes(scan.truth)
    dark = decibels(scan.image, camera.appearance)[classes == CLASSES.index("shadow")]
    lit = decibels(scan.image, camera.appearance)[classes == CLASSES.index("retina")]
    assert abs(np.median(dark)) < 3
    assert np.median(lit) > 8
    assert set(np.unique(classes)) <= set(range(len(CLASSES)))


def test_a_ghost_is_fainter_and_of_opposite_slope():
    settings, needle = ScanSettings(), BscanNeedle(ghost_db=12.0)
    camera = BscanCamera(settings, PLAIN, needle, 1)
    surfaces = Retina(STATIC, camera.x_mm, 1).advance(0, 0, None)
    with_ghost = camera.render(surfaces, (0.3, 0.3), (0.7, -0.7)).image.astype(float)
    without = BscanCamera(settings, PLAIN, replace(needle, ghost_db=60.0), 1)
    added = with_ghost - without.render(surfaces, (0.3, 0.3), (0.7, -0.7)).image
    truth = camera.render(surfaces, (0.3, 0.3), (0.7, -0.7)).truth.needle
    apex = float(truth.x_at(np.zeros(1))[0])
    rows, columns = np.nonzero(added > 60)
    slope = np.polyfit(rows, columns, 1)
    assert slope[0] == pytest.approx(-truth.along_px[0] / truth.along_px[1], rel=0.05)
    assert slope[1] == pytest.approx(apex, abs=4)


# --- the retina


@given(st.floats(0.0, 0.29), st.floats(-1.5, 1.5))
def test_before_puncture_the_ilm_is_never_above_the_tip(depth_mm, x_mm):
    retina = Retina(replace(STATIC, puncture_mm=0.3), X_MM, 1)
    tip = x_mm, retina.rest_mm(x_mm) - depth_mm
    surfaces = retina.advance(0.0, 0.1, tip)
    assert not surfaces.is_pierced
    assert np.interp(x_mm, X_MM, surfaces.ilm_mm) <= tip[1] + 0.01
    assert (surfaces.ilm_mm > surfaces.rpe_mm).all()


def test_a_released_retina_recovers_in_part_at_once_and_creeps():
    shape = replace(STATIC, prompt_share=0.6, relax_s=0.5, puncture_mm=0.5)
    retina = Retina(shape, X_MM, 1)
    rest = retina.advance(0, 0, None).ilm_mm
    tip = 0.0, retina.rest_mm(0.0) - 0.2
    for number in range(100):
        retina.advance(number * 0.1, 0.1, tip)
    dents = [float((rest - retina.advance(10 + t, 0.05, None).ilm_mm).max()) for t in np.arange(60) * 0.05]
    assert dents[0] == pytest.approx(0.4 * 0.2, rel=0.02)
    assert (np.diff(dents) < 0).all()
    assert dents[-1] < 0.1 * dents[0]
    rate = (
        -np.diff(np.log(dents)) / 0.05
    )  # exponential, slower than the dashpot alone by what the spring holds
    assert rate == pytest.approx(np.full(len(rate), 0.6 / 0.5), rel=0.15)


def test_a_retina_yields_until_puncture_and_then_recovers_along_the_needle():
    retina = Retina(replace(STATIC, puncture_mm=0.08, drag_share=0.3), X_MM, 1)
    rest = retina.rest_mm(0.0)
    depths, dents = np.arange(0, 0.2, 0.01), []
    for number, depth in enumerate(depths):
        surfaces = retina.advance(number * 0.1, 0.1, (0.0, rest - depth))
        dents.append(rest - float(np.interp(0.0, X_MM, surfaces.ilm_mm)))
        assert surfaces.is_pierced == (depth > 0.08)
    before = depths <= 0.08
    assert np.array(dents)[before] == pytest.approx(depths[before], abs=1e-6)
    after = np.flatnonzero(~before)
    assert dents[after[0]] < dents[after[0] - 1]


def test_breathing_and_heartbeat_move_the_whole_retina():
    shape = replace(STATIC, breathing_mm=0.05, breathing_hz=0.25, heartbeat_mm=0.01, heartbeat_hz=1.0)
    retina = Retina(shape, X_MM, 1)
    heights = np.array([retina.advance(t, 0.02, None).ilm_mm for t in np.arange(0, 8, 0.02)])
    assert np.ptp(heights, axis=0) == pytest.approx(np.ptp(heights[:, 0]))
    assert np.ptp(heights[:, 0]) == pytest.approx(0.12, abs=0.015)
    power = np.abs(np.fft.rfft(heights[:, 0] - heights[:, 0].mean()))
    assert np.fft.rfftfreq(400, 0.02)[power.argmax()] == pytest.approx(0.25)
