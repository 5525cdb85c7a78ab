import math

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

from haptigraph.geometry import subtract
from haptigraph.sim.robot.robot import JAWS_MOST_MM, JAWS_SPEED_MM_S, Pose, Robot, RobotLimits
from haptigraph.teleop.motion import HandMotion, TeleopSettings
from haptigraph.teleop.teleop import Teleop

RCM_MM = (7.5, 10.4)
RATE_HZ = 30.0
LIMITS = RobotLimits()
START = Pose(10.0, 0.0)

moves_mm = st.floats(-1000, 1000)
motions = st.builds(HandMotion, st.booleans(), moves_mm, moves_mm, moves_mm)
settings = st.builds(TeleopSettings, st.floats(0, 10), st.booleans(), st.floats(0, 10))


class Bench:
    """A hand and its robot, image by image."""

    def __init__(self, start: Pose = START, **settings) -> None:
        self.robot = Robot(RCM_MM, LIMITS, start)
        self.teleop = Teleop(RATE_HZ, TeleopSettings(**settings), has_jaws=True)
        self.images = 0

    def image(self, *heard: HandMotion) -> Pose:
        for motion in heard:
            self.teleop.put(motion)
        self.images += 1
        self.teleop.move(self.robot, self.images / RATE_HZ, 1 / RATE_HZ)
        return self.robot.pose


# --- the clutch


@given(st.lists(st.tuples(moves_mm, moves_mm, moves_mm), max_size=20), settings)
def test_without_the_clutch_needle_and_jaws_stand_still(displacements, given_settings):
    bench = Bench(Pose(10.0, 0.0, 1.0))
    bench.teleop.settings = given_settings
    before = bench.robot.pose
    for displacement_mm in displacements:
        assert bench.image(HandMotion(False, *displacement_mm)) == before


@pytest.mark.parametrize("tremor_filter", [False, True])
def test_letting_go_stops_the_needle_at_once(tremor_filter):
    bench = Bench(motion_scale=0.2, tremor_filter=tremor_filter)
    moving = [bench.image(HandMotion(True, 1.0, 1.0)) for _ in range(10)]
    assert moving[-1].depth_mm > 10.5
    assert bench.image(HandMotion(True, 1.0, 1.0), HandMotion(False)) == moving[-1]
    assert bench.image() == moving[-1]
    assert not bench.teleop.hand.engaged


def test_what_is_engaged_again_within_an_image_starts_anew():
    bench = Bench(motion_scale=0.1)
    bench.image(HandMotion(True, 3.0), HandMotion(False, 50.0), HandMotion(True, 2.0), HandMotion(True, 1.0))
    assert bench.robot.pose.depth_mm == pytest.approx(10.3)


def test_a_hand_that_falls_silent_has_let_go():
    bench = Bench(added_tremor_mm=0.2)
    bench.image(HandMotion(True))
    engaged = []
    for _ in range(20):
        bench.image()
        engaged.append(bench.teleop.hand.engaged)
    assert engaged == [True] * 7 + [False] * 13  # 7 images are less than 0.25 s, 8 are more
    still = bench.robot.pose
    assert bench.image() == still


# --- scale and pivot


@given(st.lists(motions, max_size=20), st.booleans(), st.floats(0, 10))
def test_with_a_scale_of_0_nothing_moves(heard, tremor_filter, added_tremor_mm):
    bench = Bench(motion_scale=0.0, tremor_filter=tremor_filter, added_tremor_mm=added_tremor_mm)
    assert bench.image(*heard) == bench.image() == Pose(10.0, 0.0)


def test_a_scale_of_0_stops_a_filtered_motion_too():
    bench = Bench(tremor_filter=True)
    before = bench.image(HandMotion(True, 2.0, 2.0))
    bench.teleop.settings = replace(bench.teleop.settings, motion_scale=0.0)
    assert bench.image(HandMotion(True, 2.0, 2.0)) == before


@given(st.floats(-11, 25), st.floats(-40, 40), st.floats(-2, 2), st.floats(0, 0.2))
def test_the_tip_goes_where_the_hand_goes_and_never_further(depth_mm, pitch_deg, across_mm, scale):
    """Through the pivot the sense stays that of the tip; in the pivot itself no turn can move it."""
    bench = Bench(Pose(depth_mm, pitch_deg), motion_scale=scale)
    before = bench.robot.tip_mm()
    shaft = bench.robot.direction()
    right = -shaft[1], shaft[0]  # turned by +90 degrees: to the right, for a needle from above
    bench.image(HandMotion(True, 0.0, across_mm))
    moved = subtract(bench.robot.tip_mm(), before)
    to_the_right_mm = moved[0] * right[0] + moved[1] * right[1]
    assert to_the_right_mm * across_mm >= 0
    assert abs(to_the_right_mm) <= scale * abs(across_mm) + 1e-12
    if abs(depth_mm) >= 5 and abs(math.degrees(scale * across_mm / depth_mm)) < 1:
        assert to_the_right_mm == pytest.approx(scale * across_mm, rel=1e-3, abs=1e-12)


@given(st.floats(-3, 3))
def test_pushing_right_moves_the_tip_right_in_the_eye_frame(across_mm):
    bench = Bench(Pose(15.0, 0.0))
    before = bench.robot.tip_mm()
    bench.image(HandMotion(True, 0.0, across_mm))
    assert (bench.robot.tip_mm()[0] - before[0]) * across_mm >= 0


def test_along_the_shaft_is_into_the_eye_by_the_scale():
    bench = Bench(motion_scale=0.25)
    assert bench.image(HandMotion(True, 1.5), HandMotion(True, 0.5)).depth_mm == pytest.approx(10.5)
    assert bench.robot.pose.pitch_deg == 0


@pytest.mark.parametrize("tremor_filter", [False, True])
def test_thumb_and_finger_move_the_jaws_by_the_scale_and_nothing_else(tremor_filter):
    bench = Bench(motion_scale=0.1, tremor_filter=tremor_filter)
    after = bench.image(HandMotion(True, apart_mm=0.5), HandMotion(True, apart_mm=0.25))
    assert (after.depth_mm, after.pitch_deg) == (10.0, 0.0)
    assert after.jaws_mm == pytest.approx(0.075)
    assert bench.image(HandMotion(True)) == after
    assert bench.image(HandMotion(True, apart_mm=-5.0)).jaws_mm == 0


@given(st.booleans(), st.floats(0, 10))
def test_a_trembling_hand_does_not_move_the_jaws(tremor_filter, added_tremor_mm):
    bench = Bench(Pose(10.0, 0.0, 1.0), tremor_filter=tremor_filter, added_tremor_mm=added_tremor_mm)
    assert {bench.image(HandMotion(True)).jaws_mm for _ in range(10)} == {1.0}


def test_jaws_hold_still_when_the_hand_falls_silent():
    bench = Bench()
    opened = [bench.image(HandMotion(True, apart_mm=0.5)).jaws_mm for _ in range(5)]
    assert [bench.image().jaws_mm for _ in range(20)] == opened[-1:] * 20
    assert not bench.teleop.hand.engaged


# --- limits


@given(st.lists(st.tuples(st.lists(motions, max_size=3), settings), max_size=25))
def test_limits_hold_whatever_the_hand_does_and_however_it_is_switched(images):
    bench = Bench()
    for heard, given_settings in images:
        bench.teleop.settings = given_settings
        before = bench.robot.pose
        after = bench.image(*heard)
        assert LIMITS.depth_min_mm <= after.depth_mm <= LIMITS.depth_max_mm
        assert abs(after.pitch_deg) <= LIMITS.pitch_limit_deg
        assert abs(after.depth_mm - before.depth_mm) <= LIMITS.speed_limit_mm_s / RATE_HZ + 1e-9
        assert abs(after.pitch_deg - before.pitch_deg) <= LIMITS.turn_limit_deg_s / RATE_HZ + 1e-9
        assert 0 <= after.jaws_mm <= JAWS_MOST_MM
        assert abs(after.jaws_mm - before.jaws_mm) <= JAWS_SPEED_MM_S / RATE_HZ + 1e-9


@pytest.mark.parametrize("sign", [1, -1])
def test_nothing_winds_up_at_a_limit(sign):
    bench = Bench()
    for _ in range(200):
        bench.image(HandMotion(True, sign * 50.0, sign * 50.0))
    at_the_limit = bench.robot.pose
    assert at_the_limit.depth_mm == (LIMITS.depth_max_mm if sign > 0 else LIMITS.depth_min_mm)
    back = bench.image(HandMotion(True, -sign * 1.0))
    assert back.depth_mm == pytest.approx(at_the_limit.depth_mm - sign * 0.2)


def test_motion_faster_than_the_robot_is_lost_not_made_up_for():
    bench = Bench(motion_scale=1.0)
    fast = bench.image(HandMotion(True, 5.0))
    assert fast.depth_mm == pytest.approx(10 + LIMITS.speed_limit_mm_s / RATE_HZ)
    assert bench.image(HandMotion(True)) == fast


@given(st.lists(settings, min_size=2, max_size=8), st.floats(-5, 5), st.floats(-5, 5))
def test_switching_moves_no_needle_whose_hand_is_still(switched, along_mm, across_mm):
    bench = Bench()
    for _ in range(5):
        bench.image(HandMotion(True, along_mm, across_mm))
    for _ in range(200):
        before = bench.image(HandMotion(True))
    for given_settings in switched:
        bench.teleop.settings = replace(given_settings, added_tremor_mm=0.0)
        after = bench.image(HandMotion(True))
        assert after.depth_mm == pytest.approx(before.depth_mm, abs=1e-9)
        assert after.pitch_deg == pytest.approx(before.pitch_deg, abs=1e-9)


# --- tremor


def depths_mm(bench: Bench, frequency_hz: float) -> np.ndarray:
    """Tremble by 0.2 mm for ten seconds, and return where the tool was once it had settled."""
    places = 0.2 * np.sin(2 * math.pi * frequency_hz * np.arange(301) / RATE_HZ)
    depths = [bench.image(HandMotion(True, step_mm)).depth_mm for step_mm in np.diff(places).tolist()]
    return np.array(depths[60:])


@given(st.integers(80, 120))
def test_the_filter_leaves_a_tenth_of_a_hands_tremor_at_the_tool(tenths_of_hz):
    without, with_filter = (
        depths_mm(Bench(tremor_filter=switched), tenths_of_hz / 10).std() for switched in (False, True)
    )
    assert without > 0.02
    assert with_filter <= 0.105 * without


def test_added_tremor_has_the_stated_strength_and_the_filter_takes_it_out():
    strength_mm = {}
    for switched in (False, True):
        bench = Bench(tremor_filter=switched, added_tremor_mm=0.3)
        depths = [bench.image(HandMotion(True)).depth_mm for _ in range(1800)]
        strength_mm[switched] = np.std(depths[60:])
    assert strength_mm[False] == pytest.approx(0.2 * 0.3, rel=0.15)
    assert strength_mm[True] < 0.11 * strength_mm[False]


def test_a_slow_motion_arrives_whole_through_the_filter():
    bench = Bench(motion_scale=0.5, tremor_filter=True)
    for _ in range(30):
        bench.image(HandMotion(True, 0.4))
    for _ in range(30):
        bench.image(HandMotion(True))
    assert bench.robot.pose.depth_mm == pytest.approx(10 + 30 * 0.4 * 0.5, abs=1e-3)


# --- messages


@given(motions)
def test_a_hand_comes_back_from_the_wire(motion):
    assert msgspec.json.decode(msgspec.json.encode(motion), type=HandMotion) == motion


def test_a_hand_that_does_not_speak_of_jaws_leaves_them():
    text = '{"engaged": true, "along_mm": 1, "across_mm": 2}'
    assert msgspec.json.decode(text, type=HandMotion) == HandMotion(True, 1.0, 2.0, 0.0)


@pytest.mark.parametrize(
    "text",
    [
        "{}",
        '{"engaged": 1}',
        '{"engaged": true, "along_mm": 1001}',
        '{"engaged": true, "along_mm": 1e999}',
        '{"engaged": true, "across_mm": NaN}',
        '{"engaged": true, "across_mm": "1"}',
        '{"engaged": true, "apart_mm": -1001}',
        '{"engaged": true, "depth_mm": 1}',
    ],
)
def test_a_hand_that_makes_no_sense_is_refused(text):
    with pytest.raises(msgspec.DecodeError):
        msgspec.json.decode(text, type=HandMotion)


@pytest.mark.parametrize("text", ['{"motion_scale": -1}', '{"motion_scale": 11}', '{"scale": 1}'])
def test_settings_that_make_no_sense_are_refused(text):
    with pytest.raises(msgspec.ValidationError):
        msgspec.json.decode(text, type=TeleopSettings)


@pytest.mark.parametrize("number", [math.nan, math.inf, -math.inf])
def test_numbers_that_are_none_are_refused_from_python_too(number):
    with pytest.raises(ValueError, match="along_mm must be a finite number"):
        HandMotion(True, number)
    with pytest.raises(ValueError, match="motion_scale must be a finite number"):
        TeleopSettings(number)


def test_what_the_hand_did_is_told():
    bench = Bench(motion_scale=0.5, tremor_filter=False)
    assert not bench.teleop.hand.engaged
    bench.image(HandMotion(True, 0.2, 0.1, 0.4), HandMotion(True, 0.1))
    hand = bench.teleop.hand
    assert (hand.engaged, hand.motion_scale, hand.tremor_filter, hand.added_tremor_mm) == (
        True,
        0.5,
        False,
        0,
    )
    assert (hand.along_mm, hand.across_mm) == pytest.approx((0.3, 0.1))
    assert (hand.asked_along_mm, hand.asked_across_mm) == pytest.approx((0.15, 0.05))
    assert (hand.apart_mm, hand.asked_apart_mm) == pytest.approx((0.4, 0.2))
