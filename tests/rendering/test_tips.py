import pytest

from rendering.layout import HEIGHT_PX, WIDTH_PX, Layout
from rendering.lot import drawn_scene
from rendering.tips import DEEP, EMPTY, NEAR_RETINA, box_px, parts_of, poses_of


@pytest.mark.parametrize("number", range(20))
def test_every_part_lies_in_the_image_and_holds_the_shaft_before_the_tip_and_the_ground_beyond(number):
    layout = Layout(drawn_scene(number))
    poses = poses_of(layout)
    assert 6 <= len(poses) <= DEEP + NEAR_RETINA
    boxes = [box_px(layout, layout.placed(pose)) for pose in poses]
    for pose, (left, top, right, bottom) in zip(poses, boxes, strict=True):
        placed = layout.placed(pose)
        x, y = layout.to_px(placed.tip_mm, placed.behind_mm)
        assert 0 <= left < x < right <= WIDTH_PX and 0 <= top < y < bottom <= HEIGHT_PX
        assert not any(each % 16 for each in (left, top, right, bottom))
        px_per_mm = layout.scene.camera.px_per_mm
        assert y - top > min(4 * px_per_mm, y - 1)
        assert bottom - y > min(1.5 * px_per_mm, HEIGHT_PX - y - 1)
    _, (first_left, _, _, last_bottom) = parts_of(layout)[EMPTY]
    assert all(first_left <= left and last_bottom >= bottom for left, _, _, bottom in boxes)


def test_the_needles_of_a_scene_are_visible_and_as_before():
    layout = Layout(drawn_scene(3))
    poses = poses_of(layout)
    assert poses == poses_of(Layout(drawn_scene(3)))
    assert all(layout.is_visible(layout.placed(pose)) for pose in poses)
    assert all(layout.is_inside(layout.placed(pose)) for pose in poses)
