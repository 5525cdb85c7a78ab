import math
from itertools import islice

import cv2
import numpy as np
import pytest
from helpers import mostly_slow
from hypothesis import given
from hypothesis import strategies as st

from haptigraph.errors import BadInput
from haptigraph.geometry import Vec, angle_between_deg, norm, subtract, unit
from haptigraph.registration.loading import parse_registration
from haptigraph.sim.eye.camera import Camera, NeedleShape
from haptigraph.sim.eye.eye import Eye, EyeShape
from haptigraph.sim.eye.optics import CameraSettings
from haptigraph.sim.eye.palette import Appearance
from haptigraph.sim.phantom import Phantom
from haptigraph.sim.robot.operator import Hand, Move, ScriptedOperator, Tremor
from haptigraph.sim.robot.robot import Pose, Robot, RobotLimits
from haptigraph.sim.scenario import load_scenario, scenario_document, scenario_names

SMALL = CameraSettings(width_px=480, height_px=270, center_px=(240.0, 148.0), px_per_mm=8.0, blur_px=0.5)
QUIET = {"read_noise_grey": 0.0, "shot_noise_grey": 0.0, "shadow": 0.0}

angles = st.floats(-60, 60)


@given(st.floats(-30, 30), angles.filter(lambda a: abs(a) > 5))
def test_the_anatomy_follows_from_the_angles(target_deg, trocar_deg):
    eye = Eye(EyeShape(target_deg=target_deg, trocar_deg=trocar_deg))
    assert norm(eye.target_mm) == pytest.approx(12.0)
    assert norm(eye.trocar_mm) == pytest.approx(12.85)
    assert math.copysign(1, eye.trocar_mm[0]) == math.copysign(1, trocar_deg)
    assert eye.target_mm[1] < 0 < eye.trocar_mm[1]


CAMERA_SCENARIOS = [name for name in scenario_names() if "scan" not in scenario_document(name).data]


@pytest.mark.parametrize(
    "name", mostly_slow(CAMERA_SCENARIOS, "align_then_approach", "bent_needle", "membrane_peeling")
)
def test_every_scenario_has_a_valid_registration_and_ground_truth(name):
    scenario = load_scenario(name)
    phantom = Phantom(scenario)
    registration = parse_registration(phantom.registration, name)
    assert registration.target.at_mm == pytest.approx(phantom.eye.target_mm, abs=0.001)
    assert registration.trocar.at_mm == pytest.approx(phantom.eye.trocar_mm, abs=0.001)
    assert 10 < phantom.operator.duration_s < 40
    moment = phantom.advance()
    assert moment.image.shape == (720, 1280, 3)
    assert not moment.truth.inside


# --- robot


@given(st.floats(-40, 40), st.floats(-15, 30))
def test_the_shaft_always_passes_through_the_rcm(pitch_deg, depth_mm):
    rcm = (5.0, 11.0)
    robot = Robot(rcm, RobotLimits(), Pose(depth_mm, pitch_deg))
    tip, along = robot.tip_mm(), robot.direction()
    offset = subtract(tip, rcm)
    assert abs(offset[0] * along[1] - offset[1] * along[0]) < 1e-9
    assert norm(offset) == pytest.approx(abs(robot.pose.depth_mm))


@given(st.tuples(st.floats(-8, 8), st.floats(-12, 0)))
def test_the_pitch_towards_a_point_aims_the_shaft_at_it(point: Vec):
    robot = Robot((7.0, 10.0), RobotLimits(), Pose(0.0, 0.0))
    robot.pose = Pose(10.0, robot.pitch_towards(point))
    assert angle_between_deg(robot.direction(), subtract(point, (7.0, 10.0))) == pytest.approx(0, abs=1e-6)


@given(st.lists(st.tuples(st.floats(-100, 100), st.floats(-180, 180)), max_size=30), st.floats(0.001, 0.1))
def test_the_robot_respects_its_limits_for_any_command(overrides, step_s):
    limits = RobotLimits()
    robot = Robot((7.0, 10.0), limits, Pose(0.0, 0.0))
    for depth_mm, pitch_deg in overrides:
        before = robot.pose
        after = robot.follow(Pose(depth_mm, pitch_deg), step_s)
        assert limits.depth_min_mm <= after.depth_mm <= limits.depth_max_mm
        assert abs(after.pitch_deg) <= limits.pitch_limit_deg
        assert abs(after.depth_mm - before.depth_mm) <= limits.speed_limit_mm_s * step_s + 1e-9
        assert abs(after.pitch_deg - before.pitch_deg) <= limits.turn_limit_deg_s * step_s + 1e-9


# --- operator


def operator(tremor_rms_mm=0.0, seed=1, scale=1.0):
    moves = (Move(1.0, 0.0, 0.0), Move(2.0, 10.0, -4.0), Move(1.0, 10.0, -4.0))
    return ScriptedOperator(moves, Hand(tremor_rms_mm=tremor_rms_mm), scale, seed, 0.0)


def test_moves_are_minimum_jerk():
    script = operator()
    assert script.duration_s == 4.0
    assert script.pose_at(0.5) == (0.0, 0.0)
    assert script.pose_at(2.0) == (5.0, -2.0)  # half way at half time
    assert script.pose_at(1.0 + 0.5)[0] == pytest.approx(10 * (10 * 0.25**3 - 15 * 0.25**4 + 6 * 0.25**5))
    assert script.pose_at(3.5) == script.pose_at(99.0) == (10.0, -4.0)
    speeds = np.diff([script.pose_at(t)[0] for t in np.linspace(1, 3, 201)])
    assert speeds.argmax() in (99, 100)
    assert speeds[0] < 0.001 * speeds.max()


def test_tremor_has_the_specified_rms_and_band():
    script = operator(tremor_rms_mm=0.2, scale=0.5)
    times = np.arange(0, 60, 1 / 200)
    tremor = np.array([script.tremor_at(t) for t in times])
    assert np.sqrt((tremor**2).mean(axis=0)) == pytest.approx([0.1, 0.1], rel=0.15)
    spectrum = np.abs(np.fft.rfft(tremor[:, 0])) ** 2
    frequencies = np.fft.rfftfreq(len(times), 1 / 200)
    band = (frequencies > 7.8) & (frequencies < 12.2)
    assert spectrum[band].sum() > 0.99 * spectrum.sum()


def test_tremor_depends_on_the_seed():
    assert operator(0.1, seed=1).tremor_at(0.3) == operator(0.1, seed=1).tremor_at(0.3)
    assert operator(0.1, seed=1).tremor_at(0.3) != operator(0.1, seed=2).tremor_at(0.3)


# --- camera


def camera(style="dark", needle=None, **settings):
    from msgspec.structs import replace

    needle = needle or NeedleShape(brightness=0.9, taper_mm=4.0)
    return Camera(Eye(EyeShape()), replace(SMALL, **settings), needle, Appearance(style=style), seed=3)


@pytest.mark.parametrize("mirrored", [False, True])
def test_tip_and_shaft_are_drawn_at_their_true_positions(mirrored):
    lens = camera(mirrored=mirrored, **QUIET)
    eye = Eye(EyeShape())
    direction = unit(subtract((-1.0, -4.0), eye.trocar_mm))
    tip = (-1.0, -4.0)
    with_needle = lens.render(tip, direction, 0).astype(float)
    without = lens.render((0.0, 60.0), (0.0, -1.0), 0).astype(float)
    difference = np.abs(with_needle - without).sum(axis=2) > 60
    rows, columns = np.nonzero(difference)
    x, y = lens.geometry.to_px(tip)
    assert rows.max() == pytest.approx(y, abs=1.5)
    assert columns[rows.argmax()] == pytest.approx(x, abs=2.0)
    back = (tip[0] - 8 * direction[0], tip[1] - 8 * direction[1])
    bx, by = lens.geometry.to_px(back)
    here = columns[rows == round(by)]
    assert here.mean() == pytest.approx(bx, abs=1.0)


def test_the_wall_occludes_the_needle():
    lens, eye = camera(**QUIET), Eye(EyeShape())
    direction = unit(subtract((0.0, 0.0), eye.trocar_mm))
    inside = lens.render((0.0, 0.0), direction, 0)
    without = lens.render((0.0, 60.0), (0.0, -1.0), 0)
    x, y = (round(v) for v in lens.geometry.to_px(eye.trocar_mm))
    assert np.array_equal(inside[y - 2 : y + 3, x - 2 : x + 3], without[y - 2 : y + 3, x - 2 : x + 3])


def test_a_shadow_darkens_the_bowl_beside_the_needle():
    eye = Eye(EyeShape())
    direction = unit(subtract((0.0, -4.0), eye.trocar_mm))
    plain = {**QUIET, "shadow": 0.0}
    lit = camera("light", **plain).render((0.0, -4.0), direction, 0).astype(int)
    shaded = camera("light", **{**plain, "shadow": 0.4}).render((0.0, -4.0), direction, 0).astype(int)
    assert (lit - shaded).max() > 20
    assert (shaded - lit).max() <= 1


def test_noise_increases_with_light_and_is_new_in_every_image():
    lens = camera("light", shot_noise_grey=6.0, read_noise_grey=1.0)
    images = np.array([lens.render((0.0, 60.0), (0.0, -1.0), n)[..., 1] for n in range(60)], float)
    bright, dark = images[:, 70, 240], images[:, 40:60, 60:80]
    ring = images[:, 148 - 104 : 148 - 100, 238:242]
    assert ring.std(axis=0).mean() > 1.3 * dark.std(axis=0).mean()
    assert bright.std() > 1
    assert not np.array_equal(images[0], images[1])


def test_the_same_number_gives_the_same_pixels():
    one, other = camera(), camera()
    assert np.array_equal(one.render((0.0, 0.0), (0.0, -1.0), 9), other.render((0.0, 0.0), (0.0, -1.0), 9))


def test_vignetting_darkens_the_corners():
    plain, vignetted = (camera(vignetting=v, **QUIET).render((0.0, 60.0), (0.0, -1.0), 0) for v in (0.0, 0.5))
    assert vignetted[0, 0].sum() == pytest.approx(0.5 * plain[0, 0].sum(), rel=0.05)
    assert abs(int(vignetted[135, 240].sum()) - int(plain[135, 240].sum())) <= 6


def test_exposure_scales_the_whole_image():
    dim, bright = (camera(exposure=e, **QUIET).render((0.0, 60.0), (0.0, -1.0), 0) for e in (0.5, 1.0))
    assert dim.mean() == pytest.approx(bright.mean() / 2, rel=0.02)


def test_the_styles_differ_in_polarity():
    for style, sign in (("light", 1), ("dark", -1)):
        scenario = load_scenario("align_then_approach" if style == "light" else "wrong_place_then_hit")
        lens = Camera(Eye(EyeShape()), SMALL, scenario.needle, Appearance(style=style), seed=1)
        eye = Eye(EyeShape())
        direction = unit(subtract((0.0, -2.0), eye.trocar_mm))
        image = cv2.cvtColor(lens.render((0.0, -2.0), direction, 0), cv2.COLOR_BGR2GRAY).astype(float)
        on = lens.geometry.to_px((-6 * direction[0], -2.0 - 6 * direction[1]))
        x, y = round(on[0]), round(on[1])
        background = np.median(image[y, x - 30 : x + 30])
        assert sign * (background - image[y, x - 1 : x + 2].mean()) > 20


# --- phantom and scenarios


def test_a_restarted_phantom_repeats_its_images(quick):
    phantom = Phantom(load_scenario(quick))
    first = [phantom.advance() for _ in range(phantom.images)]
    assert phantom.advance() is None
    phantom.restart()
    for moment in first:
        again = phantom.advance()
        assert again.truth == moment.truth
        assert np.array_equal(again.image, moment.image)


def test_the_tip_is_hidden_only_in_the_wall(quick):
    phantom = Phantom(load_scenario(quick))
    for _ in range(phantom.images):
        truth = phantom.advance().truth
        distance_mm = norm(truth.tip_mm)
        assert truth.inside == (distance_mm < 12.0)
        assert truth.visible == (not 12.0 <= distance_mm <= 13.7)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[scenario]\ndescription = 'x'\n", "key 'move' is missing"),
        ("move = []\n[scenario]\ndescription = 'x'\n", "no [[move]]; add at least one"),
        (
            "[scenario]\ndescription = 'x'\n[[move]]\nduration_s = 0\ndepth_mm = 1\ntheta_deg = 0\n",
            "line 4: duration_s: expected a positive number, found 0",
        ),
        ("[scenario]\ndescriptoin = 'x'\n", "unknown key 'descriptoin'; did you mean 'description'?"),
        (
            "[scenario]\ndescription = 'x'\n[appearance]\nstyle = 'red'\n",
            "unknown style 'red'; valid: dark, light",
        ),
    ],
)
def test_an_invalid_scenario_is_refused(tmp_path, text, message):
    file = tmp_path / "s.toml"
    file.write_text(text)
    with pytest.raises(BadInput) as refused:
        load_scenario(str(file))
    assert message in str(refused.value)
    assert str(file) in str(refused.value)


def test_an_unknown_name_lists_the_valid_scenarios():
    with pytest.raises(BadInput, match="unknown scenario 'align'; valid: align_then_approach"):
        load_scenario("align")


def test_the_tremor_at_one_image_after_another_is_that_at_their_times():
    tremor = Tremor(0.1, 8.0, 12.0, 3)
    images = list(islice(tremor.at_images(30.0), 100))
    assert images == [pytest.approx(tremor.at(number / 30.0)) for number in range(100)]
