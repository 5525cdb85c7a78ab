import cv2
import numpy as np
import pytest
from msgspec.structs import replace

from haptigraph.geometry import norm
from haptigraph.sim.eye.cannula import is_in_cannula
from haptigraph.sim.eye.distractors import Distractors
from haptigraph.sim.eye.eye import Eye
from haptigraph.sim.phantom import Phantom
from haptigraph.sim.scenes import NUISANCE_CONDITIONS, random_scene
from haptigraph.sim.sweep_scenes import ADDED_CONDITIONS, SWEEP_CONDITIONS, sweep_scene

SMALL = (720, 408)
CYCLE = len(SWEEP_CONDITIONS)
MANY = [sweep_scene(number, 4) for number in range(8 * CYCLE)]


def scenes_of(name):
    return [scene for scene in MANY if scene.nuisance == name]


def truths_of(scene):
    phantom, truths = Phantom(scene.scenario), []
    while moment := phantom.advance(draws=False):
        truths.append(moment.truth)
    return truths


def test_the_scenes_without_an_added_condition_are_those_of_random_scene():
    old = [scene for scene in MANY if scene.nuisance in NUISANCE_CONDITIONS]
    assert old == [random_scene(number, 4) for number in range(len(old))]


def test_conditions_cycle_and_a_scene_is_a_function_of_number_and_seed():
    assert [scene.nuisance for scene in MANY[:CYCLE]] == list(SWEEP_CONDITIONS)
    for number in range(CYCLE):
        assert sweep_scene(number, 4) == MANY[number]
        assert sweep_scene(number, 5) != MANY[number]
    scenarios = [scene.scenario for name in ADDED_CONDITIONS for scene in scenes_of(name)]
    assert len({scenario.about.seed for scenario in scenarios}) == len(scenarios)


@pytest.mark.parametrize("name", [name for name in ADDED_CONDITIONS if name != "color_crossing"])
def test_an_added_condition_meets_needles_of_all_polarities(name):
    assert {scene.polarity for scene in scenes_of(name)} == {"dark", "bright", "mixed"}


@pytest.mark.parametrize(("name", "scale"), [("low_resolution", 0.5), ("high_resolution", 1.5)])
def test_image_and_registration_scale_together(name, scale):
    number = SWEEP_CONDITIONS.index(name)
    scene, plain = sweep_scene(number, 4), sweep_scene(0, 4)
    sizes = [(s.scenario.camera.width_px, s.scenario.camera.height_px) for s in (scene, plain)]
    assert sizes[0] == tuple(scale * value for value in sizes[1])
    assert 18 * scale <= scene.scenario.camera.px_per_mm <= 21 * scale
    phantom = Phantom(sweep_scene(number, 4, size_px=SMALL).scenario)
    image = phantom.advance().image
    assert image.shape == (round(scale * SMALL[1]), round(scale * SMALL[0]), 3)
    assert f"width = {image.shape[1]}\nheight = {image.shape[0]}\n" in phantom.registration


def test_motion_blur_is_up_to_nine_pixels_by_the_needle_or_by_the_camera():
    cameras = [scene.scenario.camera for scene in scenes_of("motion_blur")]
    by_needle = [camera for camera in cameras if camera.shutter_s]
    assert 0 < len(by_needle) < len(cameras)
    for camera in cameras:
        assert camera.shutter_s * 20 * camera.px_per_mm < 10.5
        assert camera.shake_px <= 9
        assert bool(camera.shutter_s) != bool(camera.shake_px)


def test_the_bowl_is_darker_than_the_needle_at_one_end_and_brighter_at_the_other():
    for scene in scenes_of("color_crossing")[:3]:
        scenario = replace(scene.scenario, needle=replace(scene.scenario.needle, taper_mm=0.5))
        phantom = Phantom(scenario)
        camera, (x, y) = phantom.camera, phantom.eye.trocar_mm
        along = (-x / norm((x, y)), -y / norm((x, y)))
        tip = (x + 22 * along[0], y + 22 * along[1])
        grey, _ = camera.expect(tip, along)
        bare = cv2.cvtColor(camera.render((0.0, 200.0), (0.0, -1.0), 0), cv2.COLOR_BGR2GRAY)
        differences = []
        for depth_mm in (3, 20):
            half_mm = scene.scenario.needle.diameter_mm * 0.4
            points = [
                camera.geometry.to_px(
                    (x + depth_mm * along[0] - c * along[1], y + depth_mm * along[1] + c * along[0])
                )
                for c in np.linspace(-half_mm, half_mm, 9)
            ]
            at = tuple(np.round(np.array(points).T[::-1]).astype(int))
            differences.append(grey[at].mean() - bare[at].mean())
        assert differences[0] > 4
        assert differences[1] < -4


def test_a_tip_in_the_cannula_is_not_visible_and_comes_to_rest_beyond_it():
    seen = 0
    for scene in scenes_of("cannula"):
        eye, cannula = Eye(scene.scenario.eye), scene.scenario.cannula
        assert scene.scenario.needle.diameter_mm < cannula.diameter_mm
        assert 1 <= cannula.reach_mm <= 2.5
        moves = [move for move in scene.scenario.moves if not move.away]
        for truth in truths_of(scene):
            assert not (truth.visible and is_in_cannula(cannula, eye, truth.depth_mm))
        if moves:
            seen += 1
            assert not is_in_cannula(cannula, eye, moves[-1].depth_mm - 0.99)
            assert any(truth.visible and truth.inside for truth in truths_of(scene))
    assert seen >= 4


def test_some_clutter_is_in_the_reference_image_and_some_is_not():
    pipes = set()
    for scene in MANY:
        present, registered = scene.scenario.distractors, scene.registered
        assert (registered is not None) == (scene.nuisance == "clutter")
        if registered:
            assert present.light_pipe_mm
            assert 0 < registered.specular_highlights < present.specular_highlights
            assert 0 < registered.vessels <= present.vessels
            assert 0 < registered.lines <= present.lines
            pipes.add(bool(registered.light_pipe_mm))
    assert pipes == {False, True}


def test_more_clutter_leaves_what_was_there_before():
    scenario = sweep_scene(SWEEP_CONDITIONS.index("clutter"), 4, size_px=SMALL).scenario
    scenario = replace(scenario, camera=replace(scenario.camera, read_noise_grey=0.0, shot_noise_grey=0.0))
    images = [
        Phantom(replace(scenario, distractors=Distractors(vessels=count))).camera.render(
            (0.0, 200.0), (0.0, -1.0), 0
        )
        for count in (0, 2, 5)
    ]
    few, many = (np.abs(image.astype(int) - images[0]).max(axis=2) > 3 for image in images[1:])
    assert few.any()
    assert (many & few).sum() >= 0.99 * few.sum()
    assert many.sum() > few.sum()
