import threading

import pytest
from ros_network import until

from haptigraph.teleop.leaders.steering import Steering
from haptigraph.teleop.motion import HandMotion


class Hand:
    """A leader whose motions a test chooses."""

    def __init__(self):
        self.motions, self.polls, self.is_closed = [], 0, False

    def take(self):
        self.polls += 1
        motions, self.motions = self.motions, []
        return motions

    def close(self):
        self.is_closed = True


def test_a_thread_polls_the_leader_until_it_is_closed():
    hand, received = Hand(), []
    steering = Steering("hand", hand, received.append).start()
    until(lambda: hand.polls > 3, "nothing was polled")
    hand.motions = [HandMotion(False), HandMotion(True, 1.0)]
    until(lambda: len(received) == 2, "nothing arrived")
    assert received == [HandMotion(False), HandMotion(True, 1.0)]
    steering.close()
    assert hand.is_closed and received[-1] == HandMotion(False)
    assert "haptigraph-leader" not in {thread.name for thread in threading.enumerate()}


def test_a_release_within_one_poll_arms_what_follows():
    hand, received = Hand(), []
    steering = Steering("hand", hand, received.append)
    hand.motions = [HandMotion(True, 1.0), HandMotion(False), HandMotion(True, 2.0)]
    steering.step()
    assert received == [HandMotion(False), HandMotion(False), HandMotion(True, 2.0)]
    assert steering.take_faults() == ()


def test_a_robot_that_has_ended_does_not_end_the_thread():
    hand = Hand()

    def put(motion):
        raise BrokenPipeError

    steering = Steering("hand", hand, put).start()
    hand.motions = [HandMotion(False)]
    until(lambda: hand.polls > 5, "the thread has ended")
    with pytest.raises(BrokenPipeError):
        steering.close()
    assert hand.is_closed
