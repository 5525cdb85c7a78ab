"""A run's force: every step reaches the device's process, its hand steers, and its faults are the run's."""

import math

import pytest
from helpers import MS
from hypothesis import given
from hypothesis import strategies as st

from haptigraph.clock import VirtualClock
from haptigraph.errors import DeviceError
from haptigraph.geometry import Point, Segment, rotate
from haptigraph.grammar import ForceField
from haptigraph.graph import SceneGraph
from haptigraph.haptics.force.hand import ForceHand
from haptigraph.haptics.force.output import ForceOutput
from haptigraph.messages import OFF, Conclusion, Fault, ForceSample, HapticCommand, Observation, Step

DRAG = ForceField("drag", "viscous", damping_n_s_per_mm=0.01)


class Recorder:
    """The process and the vibration, both."""

    def __init__(self):
        self.inputs, self.steps, self.problems = [], [], ()
        self.is_silent = self.has_let_go = False
        self.fails = False

    def send(self, message, now_ns=None):
        (self.inputs if now_ns is None else self.steps).append(message)

    def take_problems(self):
        return self.problems

    def take_faults(self):
        return (Fault("device", "unplugged"),)

    def close(self):
        self.is_silent = self.has_let_go = True
        if self.fails:
            self.has_let_go = False
            raise DeviceError("it may still push")


def step_of(found, stamp_ns=5 * MS):
    conclusion = Conclusion(stamp_ns, "s", 0, "off", "", forces=("drag",))
    command = HapticCommand(stamp_ns, OFF, stamp_ns, (DRAG,))
    return Step(0, stamp_ns, Observation(stamp_ns, found), SceneGraph(stamp_ns), conclusion, command)


def outputs(scale=0.2):
    process, vibration = Recorder(), Recorder()
    return ForceOutput(process, vibration, lambda: scale), process, vibration


def test_every_step_reaches_process_and_vibration():
    output, process, vibration = outputs()
    step = step_of({"needle_tip": Point((1.0, 2.0))})
    output.send(step, 6 * MS)
    assert vibration.steps == [step]
    (given,) = process.inputs
    assert [each.kind for each in given.fixtures] == ["viscous"]
    assert (given.tip_mm, given.stamp_ns, given.scale) == ((1.0, 2.0, 0.0), 5 * MS, 0.2)


def test_a_step_without_tip_has_no_fixture():
    output, process, _ = outputs()
    output.send(step_of({}), 6 * MS)
    assert process.inputs[0].fixtures == ()


def test_an_output_that_is_off_pushes_nothing():
    process = Recorder()
    output = ForceOutput(process, Recorder(), lambda: 1.0, is_off=True)
    output.send(step_of({"needle_tip": Point((1.0, 2.0))}), 6 * MS)
    assert process.inputs[0].fixtures == ()


def test_problems_and_doubts_become_faults_and_the_vibration_is_silenced_all_the_same():
    output, process, vibration = outputs()
    process.problems = ("x: jumped",)
    assert output.take_faults() == (Fault("force", "x: jumped"), Fault("device", "unplugged"))
    process.problems, process.fails = (), True
    output.close()
    assert vibration.is_silent and not output.is_silent
    assert output.take_faults()[0] == Fault("force", "it may still push")


def test_it_is_silent_when_both_are():
    output, *_ = outputs()
    assert not output.is_silent
    output.close()
    assert output.is_silent


# --- the hand


def sample(number, position_mm, is_engaged=True):
    return ForceSample(number * 10 * MS, position_mm, (0.0, 0.0, 0.0), is_engaged)


def test_the_hand_moves_as_a_leader_does():
    hand = ForceHand(VirtualClock())
    for number, position_mm in enumerate([(0.0, 0.0, 0.0), (1.0, 2.0, 3.0)]):
        hand.add(sample(number, position_mm))
    first, second = hand.take()
    assert first.engaged and (first.along_mm, first.across_mm, first.outwards_mm) == (0.0, 0.0, 0.0)
    assert (second.across_mm, second.along_mm, second.outwards_mm) == (1.0, -2.0, 3.0)


@given(angle_deg=st.floats(-90, 90), right_mm=st.floats(-5, 5), up_mm=st.floats(-5, 5))
def test_the_tip_moves_as_the_hand_does_whatever_the_direction_of_the_shaft(angle_deg, right_mm, up_mm):
    hand = ForceHand(VirtualClock())
    shaft = rotate((0.0, -1.0), angle_deg)
    output = ForceOutput(Recorder(), Recorder(), lambda: 1.0, hand=hand)
    output.send(step_of({"needle_line": Segment((2.0, 3.0), (2.0 + shaft[0], 3.0 + shaft[1]))}), 0)
    output.send(step_of({}), 0)  # the shaft is out of sight
    for number, position_mm in enumerate([(0.0, 0.0, 0.0), (right_mm, up_mm, 0.0)]):
        hand.add(sample(number, position_mm))
    motion = hand.take()[1]
    across = rotate(shaft, 90.0)  # as HandMotion says
    tip_mm = [
        motion.along_mm * along + motion.across_mm * aside for along, aside in zip(shaft, across, strict=True)
    ]
    assert tip_mm == pytest.approx([right_mm, up_mm], abs=1e-9)


@pytest.mark.parametrize("place_mm", [(0.0, 50.0, 0.0), (math.nan, 0.0, 0.0), (0.0, -math.inf, 0.0)])
def test_a_jump_and_what_is_no_number_release_the_clutch(place_mm):
    hand = ForceHand(VirtualClock())
    for number, position_mm in enumerate([(0.0, 0.0, 0.0), place_mm, (0.0, 50.0, 0.0), (0.0, 51.0, 0.0)]):
        hand.add(sample(number, position_mm))
    motions = hand.take()
    assert [motion.engaged for motion in motions] == [True, False, True, True]
    assert [motion.along_mm for motion in motions] == [0.0, 0.0, 0.0, -1.0]


def test_motion_while_the_clutch_is_released_moves_nothing():
    hand = ForceHand(VirtualClock())
    for number, is_engaged in enumerate([True, False, True]):
        hand.add(sample(number, (0.0, 5.0 * number, 0.0), is_engaged))
    assert [(motion.engaged, motion.along_mm) for motion in hand.take()] == [(True, 0), (False, 0), (True, 0)]


def test_a_silent_device_is_lost_but_not_because_the_run_was_held_up():
    clock = VirtualClock()
    hand = ForceHand(clock)
    hand.add(sample(0, (0.0, 0.0, 0.0)))
    hand.take()
    clock.wait_until(300 * MS)
    for _ in range(4):
        assert hand.take() == []
    with pytest.raises(DeviceError, match="no position of the hand for 100 ms"):
        hand.take()
    hand.add(sample(40, (9.0, 9.0, 9.0)))
    (motion,) = hand.take()
    assert motion.along_mm == 0.0
