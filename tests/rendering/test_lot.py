import msgspec
import pytest

from rendering.lot import drawn_scene
from rendering.scene import Scene


@pytest.mark.parametrize("number", range(40))
def test_every_drawn_scene_is_one_that_a_file_could_describe(number):
    scene = drawn_scene(number)
    assert msgspec.convert(msgspec.to_builtins(scene), Scene) == scene
    assert (scene.needle.taper_mm is not None) == (scene.needle.point == "cone")
    assert (scene.needle.roll_deg is not None) == (scene.needle.point == "bevel")
    assert scene.lights


def test_a_number_gives_the_same_scene_again_and_others_give_others():
    assert drawn_scene(7) == drawn_scene(7)
    assert drawn_scene(7) != drawn_scene(8)
    assert {drawn_scene(number).needle.point for number in range(40)} == {"bevel", "blunt", "cone", "round"}
