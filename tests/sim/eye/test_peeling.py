"""Forceps, membrane and light pipe of the simulator: their positions, and their appearance in the image."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

from haptigraph.geometry import angle_between_deg, norm, rotate, subtract
from haptigraph.projection import ImageGeometry
from haptigraph.sim.eye.camera import Camera, NeedleShape
from haptigraph.sim.eye.eye import Eye, EyeShape
from haptigraph.sim.eye.forceps import Forceps, ForcepsShape
from haptigraph.sim.eye.membrane import Membrane, MembraneShape
from haptigraph.sim.eye.optics import CameraSettings
from haptigraph.sim.eye.palette import Appearance
from haptigraph.sim.eye.peeling import Peeling
from haptigraph.sim.phantom import Phantom
from haptigraph.sim.robot.operator import LightPipe
from haptigraph.sim.scenario import load_scenario

EYE = Eye(EyeShape(hemorrhage_deg=22.0, hemorrhage_mm=3.0))
SMALL = CameraSettings(
    width_px=300, height_px=300, center_px=(150.0, 150.0), px_per_mm=10.0, blur_px=0.5, mirrored=False
)
SHAPE = ForcepsShape()
DOWN = (0.0, -1.0)
points = st.tuples(st.floats(-8, 8), st.floats(-8, 8))


@given(points, st.floats(-180, 180), st.floats(0, 4))
def test_jaws_keep_their_length_and_open_symmetrically(tip_mm, turn_deg, opening_mm):
    along = rotate(DOWN, turn_deg)
    at = Forceps(SHAPE, ImageGeometry((0.0, 0.0), 1.0, False), 0.0, 0).positions(tip_mm, along, opening_mm)
    for jaw_mm in (at.left_mm, at.right_mm):
        assert norm(subtract(jaw_mm, at.hinge_mm)) == pytest.approx(SHAPE.jaw_mm)
    assert norm(subtract(at.left_mm, at.right_mm)) == pytest.approx(max(opening_mm, 0.14))
    assert angle_between_deg(subtract(at.left_mm, at.right_mm), rotate(along, 90)) == pytest.approx(
        0, abs=1e-6
    )


@given(st.lists(points, min_size=1, max_size=6))
def test_a_membrane_does_not_stretch_and_never_reattaches(way):
    membrane = Membrane(MembraneShape(), EYE)
    before = membrane._flap_mm
    for point in way:
        membrane.pull(point)
        reach_mm = norm(subtract(membrane.edge_mm, membrane._front_mm()))
        assert membrane._flap_mm >= before
        assert reach_mm <= membrane._flap_mm or not membrane._is_attached()
        before = membrane._flap_mm
    membrane.restart()
    assert membrane._flap_mm == MembraneShape().flap_mm


def test_each_jaw_opens_by_at_most_90_degrees():
    positions = Forceps(ForcepsShape(jaw_mm=0.5), ImageGeometry((0.0, 0.0), 1.0, False), 0.0, 0).positions
    assert positions((0.0, 0.0), DOWN, 4.0) == positions((0.0, 0.0), DOWN, 1.0)


def peeling() -> Peeling:
    camera = Camera(EYE, SMALL, NeedleShape(), Appearance(), 3)
    return Peeling(EYE, SHAPE, MembraneShape(), camera, 3)


def edge_after(scene: Peeling, tip_mm, jaws_mm):
    return scene.advance(tip_mm, DOWN, jaws_mm, LightPipe(-20.0, 0.0)).found["membrane_edge"].at_mm


def test_only_jaws_that_close_on_the_edge_grasp_it():
    scene = peeling()
    initial = edge_after(scene, (0.0, 0.0), 1.4)
    above = initial[0], initial[1] + 3.0
    assert edge_after(scene, above, 0.0) == initial  # closed elsewhere
    assert edge_after(scene, initial, 0.0) == initial  # came closed
    edge_after(scene, initial, 1.4)
    assert edge_after(scene, initial, 0.0) == initial
    assert edge_after(scene, above, 0.0) == above  # grasped, and lifted
    assert edge_after(scene, (0.0, 0.0), 1.4) == above  # let go
    scene.restart()
    assert edge_after(scene, (0.0, 0.0), 0.0) == initial


@pytest.mark.parametrize("name", ["left_jaw", "right_jaw", "membrane_edge", "light_pipe_tip"])
def test_entities_are_drawn_at_their_true_positions(name):
    camera = Camera(EYE, SMALL, NeedleShape(), Appearance(), 3)
    scene = Peeling(EYE, SHAPE, MembraneShape(), camera, 3)
    view = scene.advance((2.0, -3.0), DOWN, 1.4, LightPipe(9.0, 10.0))
    blank = np.full((300, 300, 3), 200, np.uint8)
    image = blank.copy()
    view.draw(image)
    x, y = (round(value) for value in camera.frontal.to_px(view.found[name].at_mm))
    around = np.s_[y - 3 : y + 4, x - 3 : x + 4]
    assert np.abs(image[around].astype(int) - blank[around]).max() > 40


def test_a_hemorrhage_is_red():
    image = Camera(EYE, SMALL, NeedleShape(), Appearance(), 3).render((0.0, 200.0), DOWN, 0)
    x, y = SMALL.center_px
    mound = EYE.on_retina(22.0, 0.3)
    blue, green, red = image[round(y - 10 * mound[1]), round(x + 10 * mound[0])].astype(int)
    assert red > 2 * max(blue, green)


def test_a_tip_can_enter_a_retina_that_is_a_layer():
    eye = Eye(EyeShape(retina_mm=1.2))
    assert norm(eye.target_mm) == pytest.approx(10.8)
    assert all(norm(point) == pytest.approx(10.8) for point in eye.retina_mm)


def test_the_same_scenario_gives_the_same_images_and_ground_truth():
    phantom, played = Phantom(replace(load_scenario("membrane_peeling"), camera=SMALL)), []
    for _ in range(2):
        played.append([phantom.advance() for _ in range(3)])
        phantom.restart()
    for one, other in zip(*played, strict=True):
        assert np.array_equal(one.image, other.image)
        assert one.truth == other.truth
        assert math.dist(one.truth.others["forceps_tip"].at_mm, one.truth.tip_mm) == 0
