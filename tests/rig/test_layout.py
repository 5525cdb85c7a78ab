"""Where the parts of a rig are: the camera sees the section along the folded path; base and parts agree."""

from pathlib import Path

import numpy as np
import pytest
from msgspec.structs import replace

from haptigraph.errors import BadInput
from haptigraph.rig.description import load_rig
from rig.feet import feet_of
from rig.layout import layout_of

FOLDER = Path(__file__).parents[2] / "rig"
RIG = load_rig(FOLDER / "d405.toml")
FILES = sorted(FOLDER.glob("*.toml"))


def test_three_sizes_of_eye_and_two_cameras_ship():
    rigs = [load_rig(file) for file in FILES]

    assert {rig.eye.diameter_mm for rig in rigs} >= {20, 24, 26}
    assert len({rig.camera.model for rig in rigs}) >= 2


@pytest.mark.parametrize("file", FILES, ids=lambda file: file.stem)
def test_the_folded_path_is_as_long_as_the_unfolded_one(file):
    rig = load_rig(file)
    layout = layout_of(rig, file)
    first = np.linalg.norm(layout.mirror_center_mm)

    assert first + np.linalg.norm(layout.camera.pupil_mm - layout.mirror_center_mm) == pytest.approx(
        rig.path_mm
    )


def test_the_camera_below_looks_up_with_its_top_towards_the_eye_and_sees_the_eye_mirrored():
    pose = layout_of(RIG, "rig.toml").camera

    assert pose.look == pytest.approx([0, 1, 0])
    assert pose.up == pytest.approx([0, 0, -1])
    assert pose.right == pytest.approx([-1, 0, 0])


def test_a_camera_that_faces_the_eye_stands_upright_before_it():
    layout = layout_of(replace(RIG, mirrors=(), direct_mm=80.0), "rig.toml")

    assert layout.camera.look == pytest.approx([0, 0, -1])
    assert layout.camera.up == pytest.approx([0, 1, 0])
    assert layout.camera.pupil_mm == pytest.approx([0, 0, 83.7])


def test_the_pupil_not_the_housing_is_on_the_axis():
    pose = layout_of(RIG, "rig.toml").camera

    assert pose.pupil_mm[[0, 2]] == pytest.approx([0, 35])
    assert pose.at(-9.0, 0.0, 3.7) == pytest.approx(pose.pupil_mm)


def test_screws_in_the_base_are_apart():
    for file in FILES:
        points = np.array(
            [point for feet in feet_of(layout_of(load_rig(file), file)).values() for point in feet]
        )
        distances_mm = np.linalg.norm(points[:, None] - points, axis=2)[~np.eye(len(points), dtype=bool)]
        assert distances_mm.min() > 6.2


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"mirrors": (replace(RIG.mirrors[0], turns="left"),)}, "turns the path left at 45°"),
        ({"mirrors": (replace(RIG.mirrors[0], angle_deg=40.0),)}, "down at 40°"),
        ({"eye": replace(RIG.eye, target_deg=58.0, retina_half_deg=60.0)}, "the target at 58° is not within"),
    ],
)
def test_what_the_mounts_are_not_drawn_for_is_refused(change, sentence):
    with pytest.raises(BadInput, match=sentence):
        layout_of(replace(RIG, **change), "rig.toml")
