"""Noise as measured makes states flicker; release and hold end that, and no alarm comes later for it."""

from itertools import pairwise

import pytest
from chatter import (
    CONTACT,
    NOISE,
    Needle,
    Noise,
    alarm_delays,
    approaches,
    conclude,
    observe,
    resting_places,
)
from hypothesis import given, settings
from hypothesis import strategies as st

from haptigraph.assemble import load_procedure
from haptigraph.registration.loading import parse_registration

PLAIN, STEADY = (load_procedure(name) for name in ("subretinal_injection", "subretinal_injection_steady"))
PLACES = ("wall 0 mm", "theta 1.7 deg", "retina 5.5 mm", "retina 0.7 mm", "axis 0.7 mm")


@pytest.fixture(scope="module")
def anatomy(registration_toml):
    return parse_registration(registration_toml, "registration.toml").anatomy


def changes(states: list[str]) -> int:
    return sum(one != other for one, other in pairwise(states))


@pytest.mark.parametrize("place", PLACES)
def test_at_every_threshold_a_tenth_of_the_changes_is_left_at_most(anatomy, place):
    places = resting_places(anatomy, PLAIN)
    assert set(places) == set(PLACES)
    seen = list(observe(anatomy, [places[place]] * 600, NOISE, seed=3))
    flickering, left = changes(conclude(PLAIN, seen)), changes(conclude(STEADY, seen))
    assert flickering > 200
    assert left <= flickering / 10


def test_what_rests_on_a_threshold_is_on_it(anatomy):
    for place, needle in resting_places(anatomy, PLAIN).items():
        moved = [Needle(needle.depth_mm + off, needle.theta_deg + 5 * off) for off in (-0.02, 0.02)]
        before, after = (conclude(PLAIN, observe(anatomy, [one], Noise(0, 0), 0)) for one in moved)
        assert before != after, place


def test_no_alarm_comes_an_image_later(anatomy):
    for seed, needles in enumerate(approaches(20, seed=1)):
        assert alarm_delays(PLAIN, STEADY, list(observe(anatomy, needles, NOISE, seed))) == 0


ways = st.lists(st.tuples(st.floats(-2, 26), st.floats(-12, 12)), min_size=1, max_size=30)


@settings(max_examples=50)
@given(ways, st.integers(0, 9))
def test_wherever_the_papers_procedure_alarms_the_steadied_one_does_in_the_same_image(anatomy, way, seed):
    seen = list(observe(anatomy, [Needle(*place) for place in way], Noise(0.05, 0.3), seed))
    plain, steady = conclude(PLAIN, seen), conclude(STEADY, seen)
    assert all(later == CONTACT for one, later in zip(plain, steady, strict=True) if one == CONTACT)


@settings(max_examples=25)
@given(st.lists(st.floats(21.0, 23.5), min_size=2, max_size=30), st.integers(0, 9))
def test_nor_does_it_where_the_needle_trembles_beside_the_target(anatomy, depths, seed):
    seen = list(observe(anatomy, [Needle(depth, 1.8) for depth in depths], Noise(0.1, 0.3), seed))
    plain, steady = conclude(PLAIN, seen), conclude(STEADY, seen)
    assert all(later == CONTACT for one, later in zip(plain, steady, strict=True) if one == CONTACT)
