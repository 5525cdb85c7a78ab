from itertools import groupby

import pytest
from msgspec.structs import replace

from haptigraph.registration.loading import parse_registration
from rendering.labels import registration_of, truth_of
from rendering.layout import Layout
from rendering.path import Pose
from rendering.scene import load_scene, scene_file, scene_names

ALL_STATES = [
    "unknown",  # no needle
    "outside_eye",
    "unknown",  # in the wall
    "misaligned_intraocular_navigation",
    "aligned_intraocular_navigation",
    "aligned_retinal_approach",
    "target_hit",
    "unknown",  # in the retina, occluded by the wall's near edge
]
START_ALIGNED = {"lot_brick", "lot_caramel", "lot_coal", "lot_cocoa", "lot_fawn", "lot_prune"}  # drawn by lot
STAYS_VISIBLE = {"lot_blush", "lot_purple"}  # to the end


@pytest.mark.parametrize("name", scene_names())
def test_every_scene_covers_all_states_from_no_needle_to_the_target(name, procedure):
    layout = Layout(load_scene(scene_file(name)))
    rows = truth_of(layout, [None, *layout.poses], procedure)
    states = [state for state in ALL_STATES if not (name in START_ALIGNED and state.startswith("misaligned"))]
    if name in STAYS_VISIBLE:
        states.pop()
    assert [state for state, _ in groupby(row.state for row in rows)] == states
    assert not rows[0].visible and not rows[0].inside
    for row in rows:
        assert (row.tip_px is None) == (not row.visible)


@pytest.mark.parametrize("roll_deg", [0.0, 45.0, 180.0])
def test_states_of_a_bevel_are_those_of_its_shaft(roll_deg, procedure):
    scene = load_scene(scene_file("wide_bevel"))
    layout = Layout(replace(scene, needle=replace(scene.needle, roll_deg=roll_deg)))
    frontal, tilted = truth_of(layout, [Pose(3.0, 0.5), Pose(3.0, 4.0)], procedure)
    assert frontal.state == "aligned_intraocular_navigation"
    assert tilted.state == "misaligned_intraocular_navigation"


@pytest.mark.parametrize("theta_deg", [-5.0, 5.0])
def test_touching_the_retina_beside_the_target_is_a_contact(theta_deg, procedure):
    layout = Layout(load_scene(scene_file("bright_bowl")))
    poses = [Pose(0.1 * tenths, theta_deg) for tenths in range(150, 235)]
    states = [state for state, _ in groupby(row.state for row in truth_of(layout, poses, procedure))]
    assert states[-3:] == ["misaligned_retinal_approach", "retinal_contact", "unknown"]


@pytest.mark.parametrize("name", scene_names())
def test_the_registration_is_that_of_the_scene(name):
    layout = Layout(load_scene(scene_file(name)))
    registration = parse_registration(registration_of(layout), "r.toml")
    assert registration.image.mm_per_px == pytest.approx(layout.image.mm_per_px)
    assert registration.trocar.at_mm == pytest.approx(layout.eye.trocar_mm, abs=1e-3)
    assert registration.target.at_mm == pytest.approx(layout.eye.target_mm, abs=1e-3)
    (other,) = registration.other_trocars
    assert other.at_mm[0] * registration.trocar.at_mm[0] < 0
