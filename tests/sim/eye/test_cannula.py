import numpy as np
import pytest
from msgspec.structs import replace

from haptigraph.geometry import rotate, unit
from haptigraph.sim.eye.camera import Camera
from haptigraph.sim.eye.cannula import CannulaShape, is_in_cannula
from haptigraph.sim.eye.eye import Eye, EyeShape
from haptigraph.sim.eye.needle import NeedleShape
from haptigraph.sim.eye.optics import CameraSettings
from haptigraph.sim.eye.palette import Appearance

SETTINGS = CameraSettings(
    width_px=480,
    height_px=270,
    center_px=(240.0, 148.0),
    px_per_mm=8.0,
    blur_px=0.5,
    read_noise_grey=0.0,
    shot_noise_grey=0.0,
    shadow=0.0,
)
EYE = Eye(EyeShape())
X, Y = EYE.trocar_mm
INWARDS = unit((-X, -Y))
AWAY = (0.0, 200.0), (0.0, -1.0)
SHAPE = CannulaShape(diameter_mm=1.0, reach_mm=2.0, brightness=0.9)


def at(depth_mm, turn_deg=0.0):
    along = rotate(INWARDS, turn_deg)
    return (X + depth_mm * along[0], Y + depth_mm * along[1]), along


def cameras(shape=SHAPE, **settings):
    needle = NeedleShape(diameter_mm=0.5, brightness=0.1)
    return [
        Camera(EYE, replace(SETTINGS, **settings), needle, Appearance(), 3, cannula=cannula)
        for cannula in (None, shape)
    ]


def changed(pose, **settings):
    bare, with_cannula = (camera.render(*pose, 0).astype(int) for camera in cameras(**settings))
    return np.abs(bare - with_cannula).max(axis=2)


@pytest.mark.parametrize("mirrored", [False, True])
@pytest.mark.parametrize("turn_deg", [0.0, 20.0])
def test_the_tube_covers_the_shaft_and_turns_with_it(turn_deg, mirrored):
    difference = changed(at(12.0, turn_deg), mirrored=mirrored)
    geometry = cameras(mirrored=mirrored)[0].geometry
    for depth_mm, is_covered in ((2.0, True), (2.5, True), (3.5, False), (8.0, False)):
        column, row = (round(value) for value in geometry.to_px(at(depth_mm, turn_deg)[0]))
        assert (difference[row, column] > 30) == is_covered


def test_the_tube_rests_perpendicular_to_the_wall_without_a_needle():
    lens = cameras()[1]
    assert np.array_equal(lens.render(*AWAY, 0), lens.render(*at(-3.0, 25.0), 0)) is False
    rows, columns = np.nonzero(changed(AWAY) > 10)
    middle = np.array(lens.geometry.to_px(EYE.trocar_mm))
    axis = np.array(lens.geometry.to_px((0.0, 0.0))) - middle
    axis /= np.hypot(*axis)
    offset = np.stack([columns, rows], axis=1) - middle
    assert abs(np.median(offset[:, 0] * axis[1] - offset[:, 1] * axis[0])) < 0.6
    assert (offset @ axis).max() / SETTINGS.px_per_mm == pytest.approx(0.85 + 2.0, abs=0.2)


def test_a_tip_is_in_the_tube_from_its_head_to_its_end():
    inside = [depth_mm for depth_mm in np.arange(-5, 5, 0.01) if is_in_cannula(SHAPE, EYE, depth_mm)]
    assert min(inside) == pytest.approx(-1.65, abs=0.02)
    assert max(inside) == pytest.approx(2.85, abs=0.02)


def test_nothing_of_a_needle_is_seen_within_the_tube():
    _, lens = cameras(CannulaShape(diameter_mm=1.0, reach_mm=2.5))
    first, second = (lens.render(*at(depth_mm), 0).astype(int) for depth_mm in (1.5, 2.0))
    y, x = np.mgrid[: first.shape[0], : first.shape[1]]
    in_eye = np.hypot(x - SETTINGS.center_px[0], y - SETTINGS.center_px[1]) < 11.8 * SETTINGS.px_per_mm
    assert np.abs(first - second)[in_eye].max() <= 1
