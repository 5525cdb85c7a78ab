import math
from itertools import pairwise

import pytest
from msgspec.structs import replace

from haptigraph.geometry import norm
from rendering.layout import HEIGHT_PX, WIDTH_PX, Layout
from rendering.path import IMAGES, Pose, needle_path
from rendering.scene import load_scene, scene_file, scene_names


def scene(name="bright_bowl"):
    return load_scene(scene_file(name))


def bevel(roll_deg):
    given = scene("dark_bowl_bevel")
    return Layout(replace(given, needle=replace(given.needle, roll_deg=roll_deg)))


@pytest.mark.parametrize("start_deg", [-7.0, 8.0])
def test_the_path_enters_at_an_angle_turns_and_ends_in_the_retina(start_deg):
    path = needle_path(22.0, start_deg)
    assert len(path) == IMAGES
    assert path[0].depth_mm == pytest.approx(-2.5, abs=0.05)
    assert [pose.theta_deg for pose in path[:10]] == pytest.approx([start_deg] * 10, abs=0.11)
    assert max(abs(pose.theta_deg) for pose in path[20:]) < 0.3
    assert path[-1].depth_mm == pytest.approx(22.05, abs=0.05)


def test_the_needle_never_jumps():
    path = needle_path(24.0, 8.0)
    for before, now in pairwise(path):
        assert abs(now.depth_mm - before.depth_mm) < 2.0
        assert abs(now.theta_deg - before.theta_deg) < 2.0


@pytest.mark.parametrize("name", scene_names())
def test_a_needle_without_angle_ends_on_the_target(name):
    layout = Layout(scene(name))
    placed = layout.placed(Pose(norm(layout.axis_mm), 0.0))
    assert placed.axis_mm == pytest.approx(layout.eye.target_mm)


def test_targets_and_trocars_are_where_the_scene_defines_them():
    layout = Layout(scene())  # the second trocar is on the left; the target 15 degrees left of the bottom
    assert layout.eye.trocar_mm[0] < 0 < layout.eye.trocar_mm[1]
    (x, y), radius_mm = layout.eye.target_mm, layout.eye.radius_mm
    assert math.degrees(math.atan2(x, -y)) == pytest.approx(-15)
    assert math.hypot(x, y) == pytest.approx(radius_mm)


def test_points_behind_the_section_are_projected_nearer_to_the_middle():
    layout = Layout(scene())
    middle_px = (WIDTH_PX - 1) / 2, (HEIGHT_PX - 1) / 2
    for at_mm in ((10.0, 3.0), (-4.0, 10.0)):
        here, behind = layout.to_px(at_mm), layout.to_px(at_mm, 200.0)
        assert math.dist(behind, middle_px) == pytest.approx(math.dist(here, middle_px) / 2)


def test_the_tip_of_a_bevel_is_half_a_width_off_the_axis_in_the_direction_of_its_roll():
    pose, half_mm = Pose(10.0, 0.0), 0.2
    beside, behind = bevel(0).placed(pose), bevel(90).placed(pose)
    assert math.dist(beside.tip_mm, beside.axis_mm) == pytest.approx(half_mm)
    assert beside.behind_mm == pytest.approx(0)
    assert behind.tip_mm == pytest.approx(behind.axis_mm)
    assert behind.behind_mm == pytest.approx(half_mm)


def test_only_the_cut_wall_occludes_a_tip():
    layout = Layout(scene())
    length_mm = norm(layout.axis_mm)
    flags = {
        depth_mm: (layout.is_visible(placed), layout.is_inside(placed))
        for depth_mm in (-2.0, -0.5, 0.0, 0.5, 2.0, 15.0, length_mm - 0.1, length_mm + 0.05)
        for placed in [layout.placed(Pose(depth_mm, 0.0))]
    }
    assert flags == {
        -2.0: (True, False),
        -0.5: (False, False),
        0.0: (False, False),
        0.5: (False, False),
        2.0: (True, True),
        15.0: (True, True),
        length_mm - 0.1: (True, True),
        length_mm + 0.05: (False, True),  # in the retina, occluded by the wall's near edge
    }


@pytest.mark.parametrize("name", scene_names())
def test_the_changing_region_is_inside_the_image_and_contains_the_path_of_the_tip(name):
    layout = Layout(scene(name))
    left, top, right, bottom = layout.changing_px()
    assert 0 <= left < right <= WIDTH_PX
    assert 0 <= top < bottom <= HEIGHT_PX
    for pose in layout.poses:
        x, y = layout.to_px(layout.placed(pose).tip_mm)
        assert left + 20 < x < right - 20
        assert top + 20 < y < bottom - 20


def test_the_second_instrument_is_in_the_other_trocar():
    layout = Layout(scene("second_instrument"))
    end_mm, direction = layout.second_instrument()
    assert layout.eye.trocar_mm[0] > 0 > end_mm[0] > layout.eyes["second"].trocar_mm[0]
    assert math.dist(end_mm, layout.eyes["second"].trocar_mm) == pytest.approx(11)
    assert direction[1] < 0
    assert Layout(scene()).second_instrument() is None
