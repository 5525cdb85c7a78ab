"""Measured noise makes states change rapidly at thresholds; release and hold prevent it without delay."""

import pytest
from chatter import (
    CONTACT,
    NOISE,
    Needle,
    Noise,
    alarm_delays,
    approaches,
    changes,
    conclude,
    observe,
    resting_needles,
)
from hypothesis import given, settings
from hypothesis import strategies as st

from haptigraph.assemble import load_procedure
from haptigraph.registration.loading import parse_registration

PLAIN, STEADY = (load_procedure(name) for name in ("subretinal_injection", "subretinal_injection_steady"))
THRESHOLDS = ("wall 0 mm", "theta 1.7 deg", "retina 5.5 mm", "retina 0.7 mm", "axis 0.7 mm")


@pytest.fixture(scope="module")
def anatomy(registration_toml):
    return parse_registration(registration_toml, "registration.toml").anatomy


@pytest.mark.parametrize("threshold", THRESHOLDS)
def test_at_every_threshold_at_most_a_tenth_of_the_changes_remains(anatomy, threshold):
    needles = resting_needles(anatomy, PLAIN)
    assert set(needles) == set(THRESHOLDS)
    observations = list(observe(anatomy, [needles[threshold]] * 600, NOISE, seed=3))
    plain, steady = changes(conclude(PLAIN, observations)), changes(conclude(STEADY, observations))
    assert plain > 200
    assert steady <= plain / 10


def test_resting_needles_are_at_their_thresholds(anatomy):
    for threshold, needle in resting_needles(anatomy, PLAIN).items():
        moved = [Needle(needle.depth_mm + off, needle.theta_deg + 5 * off) for off in (-0.02, 0.02)]
        before, after = (conclude(PLAIN, observe(anatomy, [one], Noise(0, 0), 0)) for one in moved)
        assert before != after, threshold


def test_no_alarm_is_delayed(anatomy):
    for seed, needles in enumerate(approaches(20, seed=1)):
        assert alarm_delays(PLAIN, STEADY, list(observe(anatomy, needles, NOISE, seed))) == 0


paths = st.lists(st.tuples(st.floats(-2, 26), st.floats(-12, 12)), min_size=1, max_size=30)


@settings(max_examples=50)
@given(paths, st.integers(0, 9))
def test_hysteresis_raises_every_alarm_of_the_papers_procedure_in_the_same_image(anatomy, path, seed):
    observations = list(observe(anatomy, [Needle(*pose) for pose in path], Noise(0.05, 0.3), seed))
    plain, steady = conclude(PLAIN, observations), conclude(STEADY, observations)
    assert all(later == CONTACT for one, later in zip(plain, steady, strict=True) if one == CONTACT)


@settings(max_examples=25)
@given(st.lists(st.floats(21.0, 23.5), min_size=2, max_size=30), st.integers(0, 9))
def test_hysteresis_delays_no_alarm_of_a_trembling_needle_beside_the_target(anatomy, depths, seed):
    observations = list(observe(anatomy, [Needle(depth, 1.8) for depth in depths], Noise(0.1, 0.3), seed))
    plain, steady = conclude(PLAIN, observations), conclude(STEADY, observations)
    assert all(later == CONTACT for one, later in zip(plain, steady, strict=True) if one == CONTACT)
