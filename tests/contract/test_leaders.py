"""Every leader fulfils the Leader contract. To add a leader, add a rig in `leader_rigs`."""

import math

import pytest
from leader_rigs import RIGS

from haptigraph.errors import BadInput, DeviceError
from haptigraph.teleop.leaders.leader import MAX_STEP_MM, Leader
from haptigraph.teleop.leaders.opening import LEADERS, open_leader
from haptigraph.teleop.leaders.steering import Steering

AXES = ("along_mm", "across_mm", "apart_mm", "outwards_mm")
LIBRARIES = {"crtk": "cyclonedds", "gamepad": "sdl2", "joy": "cyclonedds", "keys": "pty"}


@pytest.fixture(params=LEADERS)
def rig(request):
    pytest.importorskip(LIBRARIES[request.param], exc_type=ImportError)
    if LIBRARIES[request.param] == "cyclonedds":
        request.getfixturevalue("ros_network")
    rig = RIGS[request.param]()
    yield rig
    rig.close()


class Robot:
    """Receives motions, and sums them as a robot would."""

    def __init__(self, rig):
        self.motions, self.sentences = [], []
        self.steering = Steering(rig.uri, rig.leader, self.motions.append, self.sentences.append)

    def moved_mm(self):
        """Return how far it was moved since the last call."""
        moved = sum(abs(getattr(motion, axis)) for motion in self.motions for axis in AXES)
        self.motions.clear()
        return moved


def size_mm(motions):
    return max(abs(getattr(motion, axis)) for motion in motions for axis in AXES)


def test_all_leaders_are_under_contract():
    assert set(RIGS) == set(LIBRARIES) == set(LEADERS)


def test_a_leader_has_the_members_of_the_contract(rig):
    assert isinstance(rig.leader, Leader)


def test_the_hand_moves_the_robot_while_the_dead_man_is_pressed(rig):
    rig.hold(True)
    rig.deflect()
    motions = rig.leader.take()
    assert any(motion.engaged for motion in motions)
    assert 0 < size_mm(motions) <= MAX_STEP_MM


def test_without_the_dead_man_nothing_moves(rig):
    rig.hold(False)
    for _ in range(3):
        rig.deflect()
        for motion in rig.leader.take():
            assert not motion.engaged
            assert size_mm([motion]) == 0


def test_a_long_pause_moves_no_further_than_a_short_one(rig):
    rig.hold(True)
    rig.deflect()
    rig.wait(60_000)
    try:
        motions = rig.leader.take()
    except DeviceError:  # a topic that was silent for so long is lost
        return
    assert size_mm(motions) <= 3.0 + 1e-9


def test_a_dead_man_that_is_held_from_the_start_moves_nothing(rig):
    robot = Robot(rig)
    rig.hold(True)
    rig.leader.take()
    if rig.uri != "keys":  # which has no button to hold
        rig.deflect()
        robot.steering.step()
        assert robot.moved_mm() == 0
    rig.hold(False)
    rig.deflect()
    robot.steering.step()
    rig.hold(True)
    rig.deflect()
    robot.steering.step()
    assert robot.moved_mm() > 0


def test_a_loss_releases_the_clutch_and_is_reported_once(rig):
    robot = Robot(rig)
    rig.hold(False)
    robot.steering.step()
    rig.hold(True)
    rig.deflect()
    robot.steering.step()
    assert robot.motions[-1].engaged
    rig.lose()
    for _ in range(3):
        robot.steering.step()
        assert not robot.motions[-1].engaged
    assert len(robot.sentences) == 1 and robot.sentences[0].startswith(f"{rig.uri}: ")
    (fault,) = robot.steering.take_faults()
    assert fault.where == "leader" and fault.message == robot.sentences[0]


def test_a_leader_that_is_back_moves_nothing_until_the_dead_man_is_pressed_again(rig):
    if rig.restore is None:
        pytest.skip("does not come back")
    robot = Robot(rig)
    rig.hold(False)
    robot.steering.step()
    rig.hold(True)
    rig.lose()
    robot.steering.step()
    robot.moved_mm()
    rig.restore()
    for _ in range(3):
        rig.deflect()
        robot.steering.step()
    assert robot.moved_mm() == 0
    assert "is back; release the clutch" in robot.sentences[-1]
    rig.hold(False)
    robot.steering.step()
    rig.hold(True)
    rig.deflect()
    robot.steering.step()
    assert robot.moved_mm() > 0


def test_a_leader_can_be_closed_twice(rig):
    rig.hold(True)
    rig.leader.close()
    rig.leader.close()


def test_closing_releases_the_clutch(rig):
    robot = Robot(rig)
    rig.hold(True)
    robot.steering.close()
    robot.steering.close()
    assert not robot.motions[-1].engaged


def test_a_leader_that_raises_anything_is_lost():
    class Broken:
        def take(self):
            raise ZeroDivisionError("oops")

        def close(self):
            pass

    motions, sentences = [], []
    Steering("broken", Broken(), motions.append, sentences.append).step()
    assert [motion.engaged for motion in motions] == [False]
    assert sentences == ["broken: ZeroDivisionError: oops"]


def test_an_unknown_leader_is_refused(rig):
    with pytest.raises(BadInput, match=r"unknown leader 'gamepat'; did you mean 'gamepad'\?"):
        open_leader("gamepat:0", rig.clock)


@pytest.mark.parametrize("kind", LEADERS)
def test_an_invalid_argument_is_refused(kind, ros_network):
    from haptigraph.clock import VirtualClock

    with pytest.raises(BadInput):
        open_leader(f"{kind}:no such thing", VirtualClock())


def test_every_displacement_is_finite(rig):
    rig.hold(True)
    for _ in range(5):
        rig.deflect()
        assert all(math.isfinite(getattr(motion, axis)) for motion in rig.leader.take() for axis in AXES)
