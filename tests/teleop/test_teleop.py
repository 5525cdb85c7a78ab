import math

import hypothesis
import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

from haptigraph.geometry import subtract
from haptigraph.sim.robot.robot import JAWS_MAX_MM, JAWS_SPEED_MM_S, Pose, Robot, RobotLimits
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
    """A hand and its robot, stepped image by image."""

    def __init__(self, start: Pose = START, **settings) -> None:
        self.robot = Robot(RCM_MM, LIMITS, start)
        self.teleop = Teleop(RATE_HZ, TeleopSettings(**settings), has_jaws=True)
        self.images = 0

    def image(self, *motions: HandMotion) -> Pose:
        for motion in motions:
            self.teleop.put(motion)
        self.images += 1
        self.teleop.move(self.robot, self.images / RATE_HZ, 1 / RATE_HZ)
        return self.robot.pose


# --- the clutch


@given(st.lists(st.tuples(moves_mm, moves_mm, moves_mm), max_size=20), settings)
def test_needle_and_jaws_do_not_move_while_the_clutch_is_released(displacements, given_settings):
    bench = Bench(Pose(10.0, 0.0, 1.0))
    bench.teleop.settings = given_settings
    before = bench.robot.pose
    for displacement_mm in displacements:
        assert bench.image(HandMotion(False, *displacement_mm)) == before


@pytest.mark.parametrize("tremor_filter", [False, True])
def test_releasing_the_clutch_stops_the_needle_at_once(tremor_filter):
    bench = Bench(motion_scale=0.2, tremor_filter=tremor_filter)
    poses = [bench.image(HandMotion(True, 1.0, 1.0)) for _ in range(10)]
    assert poses[-1].depth_mm > 10.5
    assert bench.image(HandMotion(True, 1.0, 1.0), HandMotion(False)) == poses[-1]
    assert bench.image() == poses[-1]
    assert not bench.teleop.hand.engaged


def test_engaging_the_clutch_again_within_an_image_discards_earlier_motion():
    bench = Bench(motion_scale=0.1)
    bench.image(HandMotion(True, 3.0), HandMotion(False, 50.0), HandMotion(True, 2.0), HandMotion(True, 1.0))
    assert bench.robot.pose.depth_mm == pytest.approx(10.3)


def test_the_clutch_is_released_when_messages_stop():
    bench = Bench(added_tremor_mm=0.2)
    bench.image(HandMotion(True))
    engaged = []
    for _ in range(20):
        bench.image()
        engaged.append(bench.teleop.hand.engaged)
    assert engaged == [True] * 7 + [False] * 13  # 7 images are less than 0.25 s, 8 are more
    pose = bench.robot.pose
    assert bench.image() == pose


# --- motion scale and RCM


@given(st.lists(motions, max_size=20), st.booleans(), st.floats(0, 10))
def test_with_a_motion_scale_of_0_nothing_moves(messages, tremor_filter, added_tremor_mm):
    bench = Bench(motion_scale=0.0, tremor_filter=tremor_filter, added_tremor_mm=added_tremor_mm)
    assert bench.image(*messages) == bench.image() == Pose(10.0, 0.0)


def test_a_motion_scale_of_0_stops_a_filtered_motion_as_well():
    bench = Bench(tremor_filter=True)
    before = bench.image(HandMotion(True, 2.0, 2.0))
    bench.teleop.settings = replace(bench.teleop.settings, motion_scale=0.0)
    assert bench.image(HandMotion(True, 2.0, 2.0)) == before


@given(st.floats(-11, 25), st.floats(-40, 40), st.floats(-2, 2), st.floats(0, 0.2))
def test_the_tip_follows_the_direction_of_the_hand_and_never_moves_further(
    depth_mm, pitch_deg, across_mm, scale
):
    """The direction is that of the tip on either side of the RCM; at the RCM no rotation moves the tip."""
    bench = Bench(Pose(depth_mm, pitch_deg), motion_scale=scale)
    before = bench.robot.tip_mm()
    shaft = bench.robot.direction()
    right = -shaft[1], shaft[0]  # rotated by +90 degrees: to the right, for a needle from above
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


def test_motion_along_the_shaft_is_scaled():
    bench = Bench(motion_scale=0.25)
    assert bench.image(HandMotion(True, 1.5), HandMotion(True, 0.5)).depth_mm == pytest.approx(10.5)
    assert bench.robot.pose.pitch_deg == 0


@pytest.mark.parametrize("tremor_filter", [False, True])
def test_motion_of_the_fingers_is_scaled_and_moves_only_the_jaws(tremor_filter):
    bench = Bench(motion_scale=0.1, tremor_filter=tremor_filter)
    after = bench.image(HandMotion(True, apart_mm=0.5), HandMotion(True, apart_mm=0.25))
    assert (after.depth_mm, after.pitch_deg) == (10.0, 0.0)
    assert after.jaws_mm == pytest.approx(0.075)
    assert bench.image(HandMotion(True)) == after
    assert bench.image(HandMotion(True, apart_mm=-5.0)).jaws_mm == 0


@given(st.booleans(), st.floats(0, 10))
def test_tremor_does_not_move_the_jaws(tremor_filter, added_tremor_mm):
    bench = Bench(Pose(10.0, 0.0, 1.0), tremor_filter=tremor_filter, added_tremor_mm=added_tremor_mm)
    assert {bench.image(HandMotion(True)).jaws_mm for _ in range(10)} == {1.0}


def test_the_jaws_stop_when_messages_stop():
    bench = Bench()
    opened = [bench.image(HandMotion(True, apart_mm=0.5)).jaws_mm for _ in range(5)]
    assert [bench.image().jaws_mm for _ in range(20)] == opened[-1:] * 20
    assert not bench.teleop.hand.engaged


# --- limits


@given(st.lists(st.tuples(st.lists(motions, max_size=3), settings), max_size=25))
def test_the_limits_of_the_robot_hold_for_any_input_and_settings(images):
    bench = Bench()
    for messages, given_settings in images:
        bench.teleop.settings = given_settings
        before = bench.robot.pose
        after = bench.image(*messages)
        assert LIMITS.depth_min_mm <= after.depth_mm <= LIMITS.depth_max_mm
        assert abs(after.pitch_deg) <= LIMITS.pitch_limit_deg
        assert abs(after.depth_mm - before.depth_mm) <= LIMITS.speed_limit_mm_s / RATE_HZ + 1e-9
        assert abs(after.pitch_deg - before.pitch_deg) <= LIMITS.turn_limit_deg_s / RATE_HZ + 1e-9
        assert 0 <= after.jaws_mm <= JAWS_MAX_MM
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


def test_motion_faster_than_the_robot_is_lost():
    bench = Bench(motion_scale=1.0)
    fast = bench.image(HandMotion(True, 5.0))
    assert fast.depth_mm == pytest.approx(10 + LIMITS.speed_limit_mm_s / RATE_HZ)
    assert bench.image(HandMotion(True)) == fast


@given(st.lists(settings, min_size=2, max_size=8), st.floats(-5, 5), st.floats(-5, 5))
def test_a_change_of_settings_does_not_move_the_needle(changes, along_mm, across_mm):
    bench = Bench()
    for _ in range(5):
        bench.image(HandMotion(True, along_mm, across_mm))
    for _ in range(200):
        before = bench.image(HandMotion(True))
    for given_settings in changes:
        bench.teleop.settings = replace(given_settings, added_tremor_mm=0.0)
        after = bench.image(HandMotion(True))
        assert after.depth_mm == pytest.approx(before.depth_mm, abs=1e-9)
        assert after.pitch_deg == pytest.approx(before.pitch_deg, abs=1e-9)


# --- tremor


def depths_mm(bench: Bench, frequency_hz: float) -> np.ndarray:
    """Return the depth of the tool for a tremor of 0.2 mm over ten seconds, after it has settled."""
    positions = 0.2 * np.sin(2 * math.pi * frequency_hz * np.arange(301) / RATE_HZ)
    depths = [bench.image(HandMotion(True, step_mm)).depth_mm for step_mm in np.diff(positions).tolist()]
    return np.array(depths[60:])


@hypothesis.settings(max_examples=15)  # a tenth of a second each
@given(st.integers(80, 120))
def test_the_filter_reduces_tremor_of_the_tool_to_a_tenth(tenths_of_hz):
    without, with_filter = (
        depths_mm(Bench(tremor_filter=is_on), tenths_of_hz / 10).std() for is_on in (False, True)
    )
    assert without > 0.02
    assert with_filter <= 0.105 * without


def test_added_tremor_has_the_specified_rms_and_the_filter_removes_it():
    rms_mm = {}
    for is_on in (False, True):
        bench = Bench(tremor_filter=is_on, added_tremor_mm=0.3)
        depths = [bench.image(HandMotion(True)).depth_mm for _ in range(1800)]
        rms_mm[is_on] = np.std(depths[60:])
    assert rms_mm[False] == pytest.approx(0.2 * 0.3, rel=0.15)
    assert rms_mm[True] < 0.11 * rms_mm[False]


def test_the_filter_passes_the_whole_displacement_of_a_slow_motion():
    bench = Bench(motion_scale=0.5, tremor_filter=True)
    for _ in range(30):
        bench.image(HandMotion(True, 0.4))
    for _ in range(30):
        bench.image(HandMotion(True))
    assert bench.robot.pose.depth_mm == pytest.approx(10 + 30 * 0.4 * 0.5, abs=1e-3)


# --- messages


@given(motions)
def test_json_round_trip_preserves_hand_motion(motion):
    assert msgspec.json.decode(msgspec.json.encode(motion), type=HandMotion) == motion


def test_hand_motion_without_jaws_does_not_move_them():
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
def test_invalid_hand_motion_is_refused(text):
    with pytest.raises(msgspec.DecodeError):
        msgspec.json.decode(text, type=HandMotion)


@pytest.mark.parametrize("text", ['{"motion_scale": -1}', '{"motion_scale": 11}', '{"scale": 1}'])
def test_invalid_settings_are_refused(text):
    with pytest.raises(msgspec.ValidationError):
        msgspec.json.decode(text, type=TeleopSettings)


@pytest.mark.parametrize("number", [math.nan, math.inf, -math.inf])
def test_numbers_that_are_not_finite_are_refused_from_python_as_well(number):
    with pytest.raises(ValueError, match="along_mm must be a finite number"):
        HandMotion(True, number)
    with pytest.raises(ValueError, match="motion_scale must be a finite number"):
        TeleopSettings(number)


def test_the_state_of_the_hand_is_reported():
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
