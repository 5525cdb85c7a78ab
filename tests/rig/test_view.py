"""What a rig's camera sees: mounting, mirror, and the law of reflection for rigs as built."""

import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptigraph.registration.tilt import CameraTilt
from haptigraph.rig.description import Rig, load_rig, parse_rig
from haptigraph.rig.view import View, as_designed, drawn

D405 = Path(__file__).parents[2] / "rig" / "d405.toml"
TEXT = D405.read_text()


def turned(turns: str, angle_deg: float = 45.0) -> Rig:
    return parse_rig(
        TEXT.replace("[[mirror]]", f'[[mirror]]\nturns = "{turns}"\nangle_deg = {angle_deg}'), "rig.toml"
    )


@pytest.mark.parametrize(
    ("turns", "looks", "top"),
    [
        ("down", (0, 1, 0), (0, 0, -1)),
        ("up", (0, -1, 0), (0, 0, 1)),
        ("left", (1, 0, 0), (0, 1, 0)),
        ("right", (-1, 0, 0), (0, 1, 0)),
    ],
)
def test_the_camera_looks_back_along_the_folded_path_and_its_top_reflects_the_eyes(turns, looks, top):
    view = View(turned(turns), as_designed())

    right, up, back = view.camera_axes[0].T
    assert up == pytest.approx(top)
    assert -back == pytest.approx(looks)
    assert np.cross(up, back) == pytest.approx(right)  # a camera, not its mirror image
    beyond_mm = 45 + 3.7
    assert view.camera_mm[0] == pytest.approx(np.array([0, 0, 35]) - beyond_mm * np.array(looks))


@pytest.mark.parametrize("turns", ["up", "down", "left", "right"])
def test_through_a_mirror_the_eyes_top_is_on_top_and_its_right_on_the_left(turns):
    view = View(turned(turns, 40.0), as_designed())

    (middle, right, top) = view.to_px(np.array([[0, 0, 0], [10, 0, 0], [0, 10, 0]]))[0]

    px = 10 * 640 / math.tan(math.radians(43.5)) / 83.7
    assert middle == pytest.approx((639.5, 359.5))
    assert right - middle == pytest.approx((-px, 0), abs=1e-9)
    assert top - middle == pytest.approx((0, -px), abs=1e-9)


def test_without_a_mirror_right_is_right():
    direct = TEXT.split("[[mirror]]")[0].replace("[camera]", "direct_mm = 80.0\n[camera]")
    view = View(parse_rig(direct, "rig.toml"), as_designed())

    middle, right = view.to_px(np.array([[0, 0, 0], [10.0, 0, 0]]))[0]

    assert right[0] > middle[0]
    assert right[1] == pytest.approx(middle[1])


@given(
    seed=st.integers(0, 10_000),
    turns=st.sampled_from(["up", "down", "left", "right"]),
    angle_deg=st.floats(35, 55),
    point_mm=st.tuples(*(st.floats(-10, 10) for _ in range(3))),
)
def test_every_ray_is_reflected_by_the_mirror_as_built_into_the_pupil_as_built(
    seed, turns, angle_deg, point_mm
):
    rig = turned(turns, angle_deg)
    build = drawn(rig, 1, seed)
    view = View(rig, build)
    ((pixel,),) = view.to_px(np.array([point_mm]))

    # Backwards from the pixel through the real camera, off the real mirror, to the point.
    share = (pixel - view.principal_px[0]) / view.focal_px[0] * (1, -1)
    ray = view.camera_axes[0] @ np.array([*share, -1.0])
    normal, mirror_mm, pupil_mm = view.mirror_normal[0], view.mirror_mm[0], view.camera_mm[0]
    hit_mm = pupil_mm + ray * ((mirror_mm - pupil_mm) @ normal) / (ray @ normal)
    onwards = ray - 2 * (ray @ normal) * normal
    to_point_mm = np.array(point_mm) + build.eye_mm[0] - hit_mm
    assert ray @ normal < 0  # it meets the reflecting side
    assert np.linalg.norm(np.cross(onwards, to_point_mm)) / np.linalg.norm(onwards) < 1e-6
    assert onwards @ to_point_mm > 0


@given(st.integers(0, 10_000))
def test_roll_and_tilt_are_those_by_which_a_registration_describes_a_camera(seed):
    rig = load_rig(D405)
    view = View(rig, drawn(rig, 1, seed))
    center = view.to_px(np.zeros((1, 3)))[0, 0]
    tilt = CameraTilt(
        tuple(center),
        tuple(np.radians(view.tilt_deg[0])),
        float(view.focal_px[0]),
        tuple(view.principal_px[0]),
    )
    px_per_mm = view.focal_px[0] / view.center_depth_mm[0]
    roll = math.radians(view.roll_deg[0])

    for x, y in ((8.0, 0.0), (0.0, -12.0), (-5.0, 7.0)):
        right, down = -x * px_per_mm, -y * px_per_mm  # mirrored
        frontal = (
            center[0] + right * math.cos(roll) - down * math.sin(roll),
            center[1] + right * math.sin(roll) + down * math.cos(roll),
        )
        seen = view.to_px(np.array([[x, y, 0.0]]))[0, 0]
        # Roll and tilt do not commute; at these tolerances the order matters by hundredths of a pixel.
        assert tilt.image_from_frontal(frontal) == pytest.approx(tuple(seen), abs=0.15)


def test_draws_are_repeatable_and_a_row_is_one_of_them():
    rig = load_rig(D405)
    many, again = drawn(rig, 5, 3), drawn(rig, 5, 3)

    points = np.array([[0.0, 3.0, 0.0]])
    assert (View(rig, many).to_px(points) == View(rig, again).to_px(points)).all()
    assert View(rig, many.row(2)).to_px(points)[0] == pytest.approx(View(rig, many).to_px(points)[2])
    assert (View(rig, drawn(rig, 5, 4)).to_px(points) != View(rig, many).to_px(points)).all()


def test_target_and_ports_lie_where_the_design_has_them():
    rig = load_rig(D405)
    view = View(rig, as_designed())

    target_mm, (first_mm, second_mm) = view.target_mm[0, 0], view.ports_mm[0]

    assert target_mm == pytest.approx((12 * math.sin(math.radians(9)), -12 * math.cos(math.radians(9)), 0))
    assert first_mm == pytest.approx(
        (12.9 * math.sin(math.radians(36)), 12.9 * math.cos(math.radians(36)), 0)
    )
    assert second_mm == pytest.approx(first_mm * (-1, 1, 1))
