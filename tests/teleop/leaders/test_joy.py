import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

pytest.importorskip("cyclonedds")

from haptigraph.clock import VirtualClock
from haptigraph.ros2.types import Header, Joy
from haptigraph.teleop.leaders.joy import CLUTCH, OUTWARDS, JoySteering
from haptigraph.teleop.leaders.sticks import SPEED_MM_S


@pytest.fixture
def clock():
    return VirtualClock()


@pytest.fixture
def moved():
    return []


@pytest.fixture
def steering(clock, moved):
    return JoySteering(moved.append, clock)


def joy(across=0.0, along=0.0, clutch=1):
    return Joy(Header(), [across, along], [0] * CLUTCH + [clutch])


def test_full_deflection_moves_at_full_speed(steering, clock, moved):
    for _ in range(20):
        clock.wait_until(clock.now_ns() + 50_000_000)
        steering.take(joy(along=-1.0))
    assert sum(motion.along_mm for motion in moved) == pytest.approx(SPEED_MM_S)
    assert all(motion.across_mm == 0 for motion in moved)


def test_right_moves_to_the_right_and_back_into_the_eye(steering, clock, moved):
    clock.wait_until(10_000_000)
    steering.take(joy(across=-1.0, along=-1.0))  # ROS: left and forward are positive
    assert moved[0].across_mm > 0 and moved[0].along_mm > 0


def test_a_message_after_a_long_silence_is_applied_for_a_tenth_of_a_second(steering, clock, moved):
    clock.wait_until(10_000_000_000)
    steering.take(joy(along=-1.0))
    assert moved[0].along_mm == pytest.approx(0.1 * SPEED_MM_S)


def test_without_the_clutch_nothing_moves(steering, clock, moved):
    clock.wait_until(50_000_000)
    steering.take(joy(1.0, 1.0, clutch=0))
    assert (moved[0].engaged, moved[0].along_mm, moved[0].across_mm) == (False, 0, 0)


@pytest.mark.parametrize(
    "message",
    [
        Joy(Header(), [], []),
        Joy(Header(), [0.0], [1] * 12),
        Joy(Header(), [0.0, 0.0], [1]),
        Joy(Header(), [math.nan, 0.0], [1] * 12),
        Joy(Header(), [0.0, -math.inf], [1] * 12),
    ],
)
def test_an_invalid_message_releases_the_clutch(steering, moved, message):
    with pytest.raises(ValueError, match="joy has "):
        steering.take(message)
    assert [motion.engaged for motion in moved] == [False]


def right_stick(forward, clutch=1):
    axes = [0.0] * OUTWARDS + [forward]
    return Joy(Header(), axes, [0] * CLUTCH + [clutch])


def test_the_right_stick_moves_towards_the_surgeon_once_it_has_been_at_rest(steering, clock, moved):
    for forward in (-1.0, 0.0, -1.0, 1.0):  # of a trigger that rests at 1, the first readings are no motion
        clock.wait_until(clock.now_ns() + 50_000_000)
        steering.take(right_stick(forward))
    assert [motion.outwards_mm for motion in moved] == pytest.approx([0.0, 0.0, 1.5, -1.5])


@given(
    axes=st.lists(st.floats(width=32), max_size=6),
    buttons=st.lists(st.integers(-(2**31), 2**31 - 1), max_size=8),
)
def test_no_message_exceeds_the_maximum_speed(axes, buttons):
    clock, moved = VirtualClock(), []
    steering = JoySteering(moved.append, clock)
    clock.wait_until(50_000_000)
    try:
        steering.take(Joy(Header(), axes, buttons))
    except ValueError:
        assert not moved[-1].engaged
    limit_mm = SPEED_MM_S * 0.05 + 1e-9
    assert len(moved) == 1
    for size_mm in (moved[0].along_mm, moved[0].across_mm, moved[0].outwards_mm):
        assert abs(size_mm) <= limit_mm
