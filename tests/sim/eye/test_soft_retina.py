"""The deformable retina of the camera phantom: its surface, its recovery, and its appearance in the image."""

import math
from itertools import pairwise

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec import json
from msgspec.structs import replace

from haptigraph.errors import BadInput
from haptigraph.geometry import Polyline, angle_between_deg, crosses_polyline, distance_to_polyline, norm
from haptigraph.messages import Truth
from haptigraph.sim.eye.eye import Eye, EyeShape
from haptigraph.sim.eye.optics import CameraSettings
from haptigraph.sim.eye.soft_retina import MAX_DENT_SHARE, SoftRetina
from haptigraph.sim.phantom import Phantom
from haptigraph.sim.robot.operator import Hand, Move
from haptigraph.sim.scenario import load_scenario
from haptigraph.sim.tissue import Dent, TissueShape
from haptigraph.teleop.motion import HandMotion, TeleopSettings
from haptigraph.teleop.teleop import Teleop

SMALL = CameraSettings(width_px=480, height_px=270, center_px=(240.0, 148.0), px_per_mm=10.0, blur_px=0.5)
EYE = Eye(EyeShape(retina_mm=1.2))
REST_MM = 10.8
TISSUE = TissueShape(puncture_mm=0.6, dent_mm=0.8)
SURFACE = "retina_surface"

shapes = st.builds(
    TissueShape,
    dent_mm=st.floats(0.05, 3),
    puncture_mm=st.floats(0, 1),
    drag_share=st.floats(0, 1),
    prompt_share=st.floats(0, 1),
    relax_s=st.floats(0.01, 60),
)


def below(turn_deg: float, depth_mm: float) -> tuple[float, float]:
    """A point at a depth below the resting surface."""
    return EYE.on_retina(turn_deg, -depth_mm)


def depths_mm(line: Polyline) -> np.ndarray:
    return np.hypot(*line.columns_mm) - REST_MM


def soft(moves=None, rate_hz=15.0, **camera):
    """The shipped scenario with small images and without tremor."""
    scenario = load_scenario("soft_retina")
    return replace(
        scenario,
        moves=moves or scenario.moves,
        camera=replace(SMALL, **camera),
        operator=Hand(tremor_rms_mm=0.0),
        about=replace(scenario.about, rate_hz=rate_hz),
    )


PRESS = (Move(0.4, 21.0, 0.0), Move(0.8, 22.4, 0.0), Move(1.0, 22.4, 0.0), Move(0.2, 20.0, 0.0))


def along(image, points_px):
    """The interpolated blue value at every point."""
    x, y = points_px.astype(np.float32).T
    return cv2.remap(image[..., 0].astype(np.float32), x, y, cv2.INTER_LINEAR)[:, 0]


def play(phantom, **options):
    return [phantom.advance(**options) for _ in range(phantom.images)]


# --- the surface


@given(shapes, st.lists(st.tuples(st.floats(-180, 180), st.floats(-11, 30)), min_size=1, max_size=20))
def test_the_dent_never_reaches_the_wall(shape, tips):
    retina = SoftRetina(shape, EYE)
    for turn_deg, depth_mm in tips:
        retina.advance(0.1, below(turn_deg, depth_mm))
        assert depths_mm(retina.surface()).min() > -1e-9
        assert depths_mm(retina.surface()).max() <= MAX_DENT_SHARE * 1.2 + 1e-9


@given(st.floats(-74, 74), st.floats(0, 0.6))
def test_before_puncture_the_tip_is_on_the_surface(turn_deg, depth_mm):
    retina = SoftRetina(TISSUE, EYE)
    retina.advance(0.1, below(turn_deg, depth_mm))
    assert distance_to_polyline(below(turn_deg, depth_mm), retina.surface()) < 0.01
    assert depths_mm(retina.surface()).max() == pytest.approx(depth_mm, abs=0.01)


@given(st.floats(-60, 60), st.floats(0.05, 0.6), st.floats(0.1, 2))
def test_a_dent_decays_exponentially_to_both_sides(turn_deg, depth_mm, beside_mm):
    retina = SoftRetina(TISSUE, EYE)
    retina.advance(0.1, below(turn_deg, depth_mm))
    x, y = retina.surface().columns_mm
    along_mm = (np.arctan2(x, -y) - math.radians(turn_deg)) * REST_MM
    for side in (-1, 1):
        depth = np.interp(side * beside_mm, along_mm, depths_mm(retina.surface()))
        assert depth == pytest.approx(depth_mm * math.exp(-beside_mm / 0.8), abs=0.012)


def test_the_resting_surface_equals_the_registered_contour():
    points = SoftRetina(TISSUE, EYE).surface().points_mm
    assert len(points) == len(EYE.retina_mm)
    for point, registered in zip(points, EYE.retina_mm, strict=True):
        assert point == pytest.approx(registered, abs=1e-9)


def test_after_puncture_the_surface_recovers_along_the_needle():
    retina, deepest = SoftRetina(TISSUE, EYE), []
    for depth_mm in (0.2, 0.5, 0.59, 0.7, 0.9):
        retina.advance(0.1, below(5.0, depth_mm))
        deepest.append(depths_mm(retina.surface()).max())
    assert deepest[:3] == pytest.approx([0.2, 0.5, 0.59], abs=0.01)
    assert deepest[3:] == pytest.approx([0.3 * 0.7, 0.3 * 0.9], abs=0.01)
    assert crosses_polyline((0.0, 0.0), below(5.0, 0.9), retina.surface())


@given(st.floats(0.1, 0.9), st.floats(0.1, 5), st.floats(0.02, 0.2))
def test_on_release_it_recovers_in_part_and_creeps_at_the_dashpot_rate(prompt, relax_s, step_s):
    shape = TissueShape(puncture_mm=1, prompt_share=prompt, relax_s=relax_s)
    dent = Dent(shape, np.linspace(-1, 1, 21))
    dent.advance(1e3, (0.0, 0.5))
    left = [dent.advance(step_s, None).max() for _ in range(6)]
    assert left[0] == pytest.approx(0.5 * (1 - prompt))
    # The dashpot yields to the surface, which follows it by the spring's share.
    share = 1 - prompt * -math.expm1(-step_s / relax_s)
    assert [after / before for before, after in pairwise(left)] == pytest.approx([share] * 5)


# --- the phantom


def test_the_shipped_scenario_dents_the_target_without_puncture_and_recovers():
    phantom = Phantom(load_scenario("soft_retina"))
    moments = [moment for moment in play(phantom, draws=False) if moment.truth.depth_mm > 5]
    deepest = np.array([depths_mm(moment.truth.others[SURFACE]).max() for moment in moments])
    tips = np.array([norm(moment.truth.tip_mm) - REST_MM for moment in moments])
    assert deepest.max() > 0.45
    assert tips.max() < phantom.scenario.tissue.puncture_mm
    assert np.all(deepest > tips - 0.02)  # the tip is never beyond the surface
    pressed = moments[int(deepest.argmax())].truth
    assert angle_between_deg(pressed.tip_mm, phantom.eye.target_mm) < 2
    free = tips < -0.5
    let_go = deepest[(np.arange(len(tips)) > deepest.argmax()) & free]
    assert let_go[0] > 0.1
    assert let_go[-1] < 0.05


def test_a_restart_and_another_phantom_give_the_same_images():
    phantom = Phantom(soft(PRESS))
    first = play(phantom)
    phantom.restart()
    for again in (phantom, Phantom(soft(PRESS))):
        for before, now in zip(first, play(again), strict=True):
            assert np.array_equal(before.image, now.image)
            assert before.truth == now.truth


def test_a_rigid_retina_gives_the_same_images_until_contact():
    rigid = replace(soft(PRESS), tissue=None)
    touched = False
    for moment, still in zip(play(Phantom(soft(PRESS))), play(Phantom(rigid)), strict=True):
        assert still.truth.others == {}
        assert replace(moment.truth, others={}) == still.truth
        touched = touched or norm(moment.truth.tip_mm) > REST_MM
        assert np.array_equal(moment.image, still.image) == (not touched)


def test_a_dent_does_not_persist_in_the_background():
    phantom, rigid = Phantom(soft(PRESS)), Phantom(replace(soft(PRESS), tissue=None))
    play(phantom)
    bare, again = ((each.camera.render((0.0, 60.0), (0.0, -1.0), 3)) for each in (rigid, phantom))
    assert np.array_equal(bare, again)


@pytest.mark.parametrize(
    ("style", "mirrored", "tilt_deg"),
    [
        ("light", False, (0.0, 0.0)),
        ("light", True, (10.0, -6.0)),
        ("dark", True, (0.0, 0.0)),
        ("dark", False, (-8.0, 8.0)),
    ],
)
def test_the_image_shows_the_true_surface(style, mirrored, tilt_deg):
    """Beside the needle, the blue of the image changes at the true surface."""
    near = {"px_per_mm": 20.0, "center_px": (240.0, 20.0)}
    quiet = near | {"read_noise_grey": 0.0, "shot_noise_grey": 0.0, "shadow": 0.0}
    scenario = soft(PRESS[:3], mirrored=mirrored, tilt_deg=tilt_deg, **quiet)
    phantom = Phantom(replace(scenario, appearance=replace(scenario.appearance, style=style, texture=0.0)))
    moment = play(phantom)[-1]
    geometry, eye = phantom.camera.geometry, phantom.eye
    x, y = moment.truth.others[SURFACE].columns_mm
    turn_deg = math.degrees(math.atan2(moment.truth.tip_mm[0], -moment.truth.tip_mm[1]))
    for beside_deg in (-3.5, -2.5, 2.5, 3.5):
        at_deg = turn_deg + beside_deg
        depth = np.interp(math.radians(at_deg), np.arctan2(x, -y), np.hypot(x, y) - REST_MM)
        depths = np.linspace(-0.3, 0.9, 241)
        points_px = [geometry.to_px(eye.on_retina(at_deg, -each)) for each in depths.tolist()]
        blue = cv2.blur(along(moment.image, np.array(points_px)), (1, 15))[:, 0]
        visible = depths[20:-20][np.abs(np.gradient(blue))[20:-20].argmax()]
        assert 0.2 < depth < 0.5
        assert visible == pytest.approx(depth, abs=0.05)  # half a pixel


def test_teleoperation_dents_it_too():
    scenario = soft((Move(1.0, 21.4, 0.0),), rate_hz=30.0)
    hand = Teleop(30.0, TeleopSettings(motion_scale=1.0, tremor_filter=False), 1)
    phantom, deepest = Phantom(scenario, hand), []
    for along_mm in [0.1] * 13 + [-0.5] * 5:
        hand.put(HandMotion(True, along_mm, 0.0))
        deepest.append(depths_mm(phantom.advance(draws=False).truth.others[SURFACE]).max())
    assert max(deepest) > 0.2
    assert deepest[-1] < 0.7 * max(deepest)


def test_a_needle_that_is_away_releases_it():
    away = replace(PRESS[2], away=True)
    moments = play(Phantom(soft((*PRESS[:3], away, away))))
    deepest = [depths_mm(moment.truth.others[SURFACE]).max() for moment in moments]
    assert deepest[-1] < 0.4 * max(deepest)
    assert not moments[-1].truth.visible


@pytest.mark.parametrize(
    ("eye", "tissue", "more", "message"),
    [
        ("", "", "", "line 3: [tissue] needs a retina that is a layer, but eye.retina_mm is 0"),
        ("retina_mm = 0.5", "puncture_mm = 0.45", "", "expected less than 0.45 (0.9 of eye.retina_mm)"),
        ("retina_mm = 0.5", "relax_s = 0", "", "tissue.relax_s: expected float >= 0.01, found 0"),
        ("retina_mm = 0.5", "dent = 0.2", "", "unknown key 'dent'; did you mean 'dent_mm'?"),
        ("retina_mm = 0.5", "", "[forceps]", "[tissue] cannot be combined with [forceps]"),
    ],
)  # fmt: skip
def test_invalid_tissue_is_refused(tmp_path, eye, tissue, more, message):
    file = tmp_path / "mine.toml"
    file.write_text(
        f'[scenario]\ndescription = "x"\n[tissue]\n{tissue}\n[eye]\n{eye}\n{more}\n'
        "[[move]]\nduration_s = 1\ndepth_mm = 0\ntheta_deg = 0\n"
    )
    with pytest.raises(BadInput) as refused:
        load_scenario(str(file))
    assert message in str(refused.value)
    assert str(refused.value).startswith(str(file))
    assert "\n" not in str(refused.value)


def test_the_ground_truth_survives_serialization():
    truth = Phantom(soft(PRESS)).advance(draws=False).truth
    assert json.decode(json.encode(truth), type=Truth) == truth
