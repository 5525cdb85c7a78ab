import math
from itertools import pairwise

import pytest

from haptigraph.geometry import norm, rotate, subtract, unit
from haptigraph.registration.loading import parse_registration
from haptigraph.sim.eye.eye import Eye, RegistrationError
from haptigraph.sim.phantom import Phantom
from haptigraph.sim.scenes import NUISANCE_CONDITIONS, POLARITIES, random_scene

MANY = [random_scene(number, 4) for number in range(132)]
SMALL = (480, 270)


def rest(scene):
    """The last move with the needle in view; None without a needle."""
    visible = [move for move in scene.scenario.moves if not move.away]
    return visible[-1] if visible else None


def test_a_scene_is_a_function_of_number_and_seed():
    assert random_scene(7, 1) == random_scene(7, 1)
    assert random_scene(7, 1) != random_scene(7, 2)
    assert random_scene(7, 1) != random_scene(18, 1)


def test_nuisance_conditions_cycle_and_each_has_all_polarities():
    assert [scene.nuisance for scene in MANY[:11]] == list(NUISANCE_CONDITIONS)
    for name in NUISANCE_CONDITIONS:
        found = {scene.polarity for scene in MANY if scene.nuisance == name}
        assert found == set(POLARITIES)


def test_depths_cover_the_range_and_some_scenes_have_no_needle():
    depths = [rest(scene).depth_mm for scene in MANY if rest(scene)]
    assert min(depths) < 1.5
    assert max(depths) > 20
    assert sum(depth < 3 for depth in depths) >= 15
    assert 5 < sum(rest(scene) is None for scene in MANY) < 35
    leaving = [s for s in MANY if rest(s) and s.scenario.moves[-1].away]
    assert 5 < len(leaving) < 35


def test_scenes_start_with_an_empty_globe_and_end_short_of_the_retina():
    for scene in MANY:
        first, last = scene.scenario.moves[0], rest(scene)
        assert first.away or first.depth_mm < 0
        if last:
            eye = Eye(scene.scenario.eye)
            axis = unit(subtract(eye.target_mm, eye.trocar_mm))
            along = rotate(axis, last.theta_deg)
            tip = (
                eye.trocar_mm[0] + last.depth_mm * along[0],
                eye.trocar_mm[1] + last.depth_mm * along[1],
            )
            assert norm(tip) < eye.radius_mm or last.depth_mm < 2


@pytest.mark.parametrize("number", range(len(NUISANCE_CONDITIONS)))
def test_needles_respect_the_speed_limits(number):
    scene = random_scene(number + 11, 4, size_px=SMALL)
    phantom = Phantom(scene.scenario)
    truths = []
    while moment := phantom.advance():
        truths.append(moment.truth)
    assert 20 <= len(truths) <= 45
    for before, after in pairwise(truths):
        assert abs(after.depth_mm - before.depth_mm) <= 20 / 30 + 1e-6
        assert abs(after.theta_deg - before.theta_deg) <= 30 / 30 + 1e-6
    assert not truths[0].inside
    assert moment is None


def test_registration_errors_are_at_most_three_pixels_and_remain_valid():
    for scene in MANY:
        assert scene.has_registration_error == (scene.nuisance == "registration")
        error = scene.scenario.registration_error
        assert max(math.hypot(*shift) for shift in (error.globe_px, error.target_px, error.trocar_px)) <= 3
    for number in (8, 19, 30):
        small = random_scene(number, 4, size_px=SMALL)
        assert small.scenario.registration_error != RegistrationError()
        phantom = Phantom(small.scenario)
        given = parse_registration(phantom.registration, "given")
        true = parse_registration(phantom.true_registration, "true")
        assert math.dist(given.image.center_px, true.image.center_px) > 0.1
        assert given.image.mm_per_px == true.image.mm_per_px


def test_the_second_instrument_keeps_clear_of_the_final_tip():
    for scene in MANY:
        others, last, eye = scene.scenario.distractors, rest(scene), Eye(scene.scenario.eye)
        if not others.light_pipe_mm or last is None:
            continue
        axis = unit(subtract(eye.target_mm, eye.trocar_mm))
        along = rotate(axis, last.theta_deg)
        tip = tuple(c + last.depth_mm * a for c, a in zip(eye.trocar_mm, along, strict=True))
        rcm = eye.other_trocar_mm
        pipe = rotate(unit((-rcm[0], -rcm[1])), others.light_pipe_deg)
        reach = [
            math.dist(tip, (rcm[0] + s * pipe[0], rcm[1] + s * pipe[1]))
            for s in (others.light_pipe_mm * step / 200 for step in range(201))
        ]
        assert min(reach) > 1.4
