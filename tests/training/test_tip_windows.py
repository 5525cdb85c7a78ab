import numpy as np

from haptigraph.perception.native.tip_network import VALUES
from training.tip_windows import VARIANTS, of_scene

WITHOUT_NEEDLE, WITH_NEEDLE = 3, 0  # scenes of seed 601


def test_windows_of_a_simulated_scene_lie_about_its_true_tips():
    windows = of_scene(WITH_NEEDLE, 601)
    selected, near, wide = windows.beyond_mm.reshape(-1, 3).T
    assert windows.values.shape == (len(windows.beyond_mm), VALUES)
    assert np.median(np.abs(selected)) < 0.05 < np.median(np.abs(near)) < 0.9 < np.max(np.abs(wide))
    assert windows.context.shape == (len(windows.beyond_mm), 3) and np.all(windows.context > 0)
    again = of_scene(WITH_NEEDLE, 601)
    assert np.array_equal(again.values, windows.values)


def test_a_scene_without_needle_has_no_windows():
    assert of_scene(WITHOUT_NEEDLE, 601) is None


def test_every_variant_begins_with_half_or_keeps_the_size():
    assert {"full", "half", "motion", "noise", "jpeg"} < set(VARIANTS)
    assert [name for name in VARIANTS if "half" in name] == ["half", "half and noisy", "half and compressed"]
