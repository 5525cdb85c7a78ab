"""Motion of a hand whose messages come more slowly than the cycles of a robot's loop."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptigraph.teleop.mapping import HandMapping
from haptigraph.teleop.motion import HandMotion, TeleopSettings

CYCLE_S = 0.005
SPREAD_S = 0.04


def mapping(**settings) -> HandMapping:
    return HandMapping(200.0, TeleopSettings(**{"motion_scale": 1.0, **settings}), spread_s=SPREAD_S)


def played(one: HandMapping, every: int, count: int, along_mm: float = 0.3) -> list[float]:
    """Put a message every few cycles; return the motion of each cycle, and of ten after the last message."""
    moved = []
    for cycle in range(every * count + 10):
        if cycle % every == 0 and cycle < every * count:
            one.put(HandMotion(True, along_mm, 0.0, 0.0, 2 * along_mm))
        motion = one.take(CYCLE_S)
        moved.append(0.0 if motion is None else motion.along_mm)
    return moved


@given(st.integers(1, 8), st.integers(3, 20))
def test_the_whole_displacement_arrives_and_is_smooth(every, count):
    moved = played(mapping(), every, count)
    assert sum(moved) == pytest.approx(0.3 * count)
    steady = moved[every : every * (count - 1)]
    assert steady == pytest.approx([0.3 / every] * len(steady))


def test_a_silent_hand_moves_nothing_after_40_ms_also_not_out_of_the_filter():
    one = mapping(tremor_filter=True)
    for cycle in range(40):
        if cycle % 4 == 0:
            one.put(HandMotion(True, 0.5))
        one.take(CYCLE_S)
    after = [one.take(CYCLE_S).along_mm for _ in range(20)]
    assert any(after[:4])
    assert after[8:] == [0.0] * 12


def test_out_of_the_section_is_filtered_as_the_other_axes_are():
    rates = {}
    for is_on in (False, True):
        one = mapping(tremor_filter=is_on)
        place = 0.2 * np.sin(2 * np.pi * 10 * np.arange(1000) * CYCLE_S)
        moved = []
        for step_mm in np.diff(place).tolist():
            one.put(HandMotion(True, 0.0, 0.0, 0.0, step_mm))
            moved.append(one.take(CYCLE_S).outwards_mm)
        rates[is_on] = np.std(np.cumsum(moved)[400:])
    assert rates[True] < 0.105 * rates[False]


def test_motion_out_of_the_section_is_recorded():
    one = mapping(motion_scale=0.5)
    one.put(HandMotion(True, 0.0, 0.0, 0.0, 0.2))
    for _ in range(10):
        one.take(CYCLE_S)
        if one.hand.asked_outwards_mm:
            break
    assert one.hand.outwards_mm > 0
    assert one.hand.asked_outwards_mm == pytest.approx(0.5 * one.hand.outwards_mm)


def test_discarded_motion_does_not_come_later():
    one = mapping()
    one.put(HandMotion(True, 0.1))
    one.take(CYCLE_S)
    for _ in range(4):
        one.take(CYCLE_S)
    one.put(HandMotion(True, 4.0))
    one.take(CYCLE_S)
    one.discard()
    assert [one.take(CYCLE_S).along_mm for _ in range(6)] == [0.0] * 6
