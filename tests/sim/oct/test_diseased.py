"""Random B-scans with detailed tissue."""

import numpy as np
import pytest

from haptigraph.sim.oct.bscan import CLASSES
from haptigraph.sim.oct.diseased import random_detailed_scene
from haptigraph.sim.oct.lesions import LesionSettings


def test_the_same_number_gives_the_same_image():
    one, other = (random_detailed_scene(3, 5, diseased=True).take() for _ in range(2))
    assert np.array_equal(one.image, other.image)
    assert not np.array_equal(one.image, random_detailed_scene(4, 5, diseased=True).take().image)


def test_only_diseased_scenes_have_lesions():
    kinds = "drusen", "detachment_mm", "fluid_mm", "cysts", "atrophy_mm"
    for number in range(20):
        healthy, diseased = (
            random_detailed_scene(number, 5, diseased=each).detail.lesions for each in (False, True)
        )
        assert healthy == LesionSettings(pit_mm=healthy.pit_mm)
        assert any(getattr(diseased, kind) for kind in kinds)


@pytest.mark.parametrize("place", ["none", "above", "inside"])
def test_a_needle_only_where_one_is_asked_for(place):
    scene = random_detailed_scene(7, 5, diseased=True, place=place)
    camera = scene.camera()
    truth = scene.take(camera).truth
    assert (truth.needle is None) == (place == "none")
    classes = camera.classes(truth)
    assert (CLASSES.index("shadow") in classes) == (place != "none")
    assert truth.is_pierced == (place == "inside")


def test_a_tip_above_lesions_is_above_their_ilm():
    for number in range(12):
        truth = random_detailed_scene(number, 6, diseased=True, place="above").take().truth
        x, y = truth.needle.tip_px
        assert y < np.interp(x, np.arange(512), truth.ilm_px)


def test_surfaces_keep_their_order():
    for number in range(12):
        truth = random_detailed_scene(number, 8, diseased=True).take().truth
        assert (truth.rpe_px > truth.ilm_px).mean() > 0.99
