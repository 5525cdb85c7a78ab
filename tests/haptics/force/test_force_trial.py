"""The trial of a force device: nothing before the clutch, a wall below the hand, an end when it is let go."""

import pytest
from helpers import MS

from haptigraph.clock import VirtualClock
from haptigraph.haptics.force.fixture import force_n, to_hand
from haptigraph.haptics.force.trial import WALL_N, try_wall
from haptigraph.messages import ForceSample


class Hand:
    """A hand that presses after one second, goes down 9 mm, and releases after `held_s`."""

    def __init__(self, held_s):
        self.clock, self.held_s, self.inputs, self.force_n = VirtualClock(), held_s, [], (0.0, 0.0, 0.0)

    def take(self):
        time_s = self.clock.now_ns() / 1e9
        is_held = 1.0 < time_s < 1.0 + self.held_s
        at_mm = 2.0, 7.0 - min(max(time_s - 2.0, 0.0), 9.0), 0.0
        return [ForceSample(self.clock.now_ns(), at_mm, self.force_n, is_held)]

    def send(self, message):
        self.inputs.append((self.clock.now_ns(), message))
        hand_mm = self.take()[0].hand_mm
        wall = to_hand(message.fixtures[0], message.tip_mm, hand_mm, message.scale)
        self.force_n = force_n(wall, hand_mm, (0.0, 0.0, 0.0))


def test_the_wall_is_felt_where_it_is_and_never_above_its_limit():
    hand, said = Hand(held_s=100.0), []
    trial = try_wall(hand, hand.clock, said.append)
    assert hand.inputs[0][0] > 1000 * MS
    assert trial.has_begun and len(said) == 2
    assert trial.deepest_mm == pytest.approx(9.0 - 5.0, abs=0.1)
    assert trial.most_n == pytest.approx(0.8, abs=0.02) and trial.most_n <= WALL_N
    assert hand.clock.now_ns() < 11_200 * MS


def test_letting_go_ends_it():
    hand = Hand(held_s=2.0)
    assert try_wall(hand, hand.clock, lambda sentence: None).has_begun
    assert hand.clock.now_ns() < 3_100 * MS


def test_without_the_clutch_nothing_ever_pushes():
    hand = Hand(held_s=0.0)
    trial = try_wall(hand, hand.clock, lambda sentence: None)
    assert not trial.has_begun and trial.most_n == 0.0 and hand.inputs == []
