from pathlib import Path

import numpy as np
import pytest

from haptigraph.perception.native.tip_network import PLACES, STATIONS, VALUES, tip_places
from haptigraph.perception.needle.tip_network import shipped_weights
from training.tip_drawn import drawn
from training.tip_shape import ACROSS, BEHIND, STEP_MM
from training.tip_windows import NEAR, VARIANTS, of_clip, of_scene

RENDERINGS = Path(__file__).parents[1] / "data" / "renderings"
WITHOUT_NEEDLE, WITH_NEEDLE = 3, 0  # scenes of seed 601


def contrasts(windows):
    """How dark or bright each station is, (n, STATIONS)."""
    rows = windows.values.astype(float).reshape(-1, 3 * ACROSS + 1, STATIONS)
    return np.abs(rows[:, :ACROSS]).mean(axis=1)


def test_windows_of_a_simulated_scene_lie_about_its_true_tips():
    windows = of_scene(WITH_NEEDLE, 601)
    beyond_mm = windows.beyond_mm.reshape(-1, NEAR + 1)
    assert windows.values.shape == (len(windows.beyond_mm), VALUES)
    assert np.median(np.abs(beyond_mm[:, :NEAR])) < 0.7
    assert np.all(windows.noise_grey > 0)
    again = of_scene(WITH_NEEDLE, 601)
    assert np.array_equal(again.values, windows.values)


def test_a_scene_without_needle_has_no_windows():
    assert of_scene(WITHOUT_NEEDLE, 601) is None


@pytest.mark.parametrize("variant", ["full", "half and noisy"])
def test_windows_of_a_clip_show_a_shaft_up_to_the_tip_at_any_resolution(variant):
    windows = of_clip(RENDERINGS / "black_round", variant)
    is_near = np.abs(windows.beyond_mm) < 0.8
    ends = BEHIND + windows.beyond_mm[is_near] / STEP_MM
    shown = contrasts(windows)[is_near]
    stations = np.arange(STATIONS)
    before = np.array([row[stations < end - 5].mean() for row, end in zip(shown, ends, strict=True)])
    beyond = np.array([row[stations > end + 5].mean() for row, end in zip(shown, ends, strict=True)])
    assert np.mean(before > 2 * beyond) > 0.8


def test_every_variant_begins_with_half_or_keeps_the_size():
    assert {"full", "half", "motion", "noise", "jpeg"} < set(VARIANTS)
    assert [name for name in VARIANTS if "half" in name] == ["half", "half and noisy", "half and compressed"]


def test_drawn_windows_are_reproducible_and_differ_by_seed():
    one, same, other = drawn(20, 1), drawn(20, 1), drawn(20, 2)
    assert np.array_equal(one.values, same.values) and np.array_equal(one.beyond_mm, same.beyond_mm)
    assert not np.array_equal(one.values, other.values)


def test_the_shipped_network_is_certain_where_it_is_right_in_windows_that_it_has_not_learned():
    windows, weights = drawn(600, 99), shipped_weights()
    at_mm = (np.arange(PLACES) - PLACES // 2) * STEP_MM
    errors_mm, elsewhere = [], []
    for values, beyond_mm, noise_grey in zip(*windows, strict=True):
        places = tip_places(weights, values.astype(np.float32), float(noise_grey))
        mean_mm = float(places[:-1] @ at_mm / places[:-1].sum())
        sd_mm = float(np.sqrt(places[:-1] @ np.square(at_mm - mean_mm) / places[:-1].sum()))
        if abs(beyond_mm) > 1.6:
            elsewhere.append(places[-1])
        elif sd_mm < 0.12 and places[-1] < 0.3:
            errors_mm.append(abs(beyond_mm - mean_mm))
    assert len(errors_mm) > 100 and len(elsewhere) > 50
    assert np.quantile(errors_mm, 0.95) < 0.25
    assert np.mean(np.array(elsewhere) > 0.5) > 0.8
