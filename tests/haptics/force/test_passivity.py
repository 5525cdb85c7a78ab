"""Random motions gain no energy beyond the tank, limits hold, faults release; and saboteurs are found."""

import pytest
from force import (
    DELAYS_MS,
    RELEASE_MS,
    SABOTEURS,
    SESSIONS,
    STIFFNESSES_N_PER_MM,
    NoForce,
    NoTank,
    Reversed,
    broken,
    felt,
    measure,
    penetration,
)
from force_motions import MOTIONS_PER_SESSION, session
from hypothesis import given, settings
from hypothesis import strategies as st

from haptigraph.haptics.force.renderer import ForceRenderer

FEW, SEED = 2, 7_000_000


@given(st.integers(0, 2**40), st.sampled_from(DELAYS_MS))
@settings(max_examples=8, deadline=None)
def test_no_session_gains_more_than_the_tank_or_exceeds_a_limit(seed, delay_ms):
    outcome = session(seed, delay_ms)
    assert outcome.energy_mj <= 5.0
    assert outcome.excess_n <= 0.0


def test_all_bounds_hold_and_something_pushes():
    report = measure(FEW, SEED, releases=4)
    assert broken(report) == []
    assert max(report.releases_ms.values()) <= RELEASE_MS
    assert {delay_ms: one.motions for delay_ms, one in report.outcomes.items()} == dict.fromkeys(
        DELAYS_MS, FEW * MOTIONS_PER_SESSION
    )


@pytest.mark.parametrize(
    ("make", "bounds"),
    [
        (NoForce, ("vacuous", "release", "stiffness", "penetration")),
        (Reversed, ("energy", "stiffness", "penetration")),
        (NoTank, ("energy",)),
    ],
)
def test_a_saboteur_breaks_a_bound(make, bounds):
    found = broken(measure(FEW, SEED, make, releases=1))
    assert {phrase.partition(":")[0] for phrase in found} >= set(bounds)
    assert make in SABOTEURS


@pytest.mark.parametrize("stiffness_n_per_mm", STIFFNESSES_N_PER_MM)
def test_without_delay_a_wall_is_as_stiff_as_asked_for(stiffness_n_per_mm):
    assert felt(ForceRenderer, stiffness_n_per_mm) >= 0.8
    assert penetration(ForceRenderer, stiffness_n_per_mm) <= 1.2


@pytest.mark.slow
@pytest.mark.timeout(7200)
def test_all_bounds_hold_in_10_000_motions_for_each_delay():
    report = measure(SESSIONS, SEED + FEW)
    assert broken(report) == []
    assert min(one.motions for one in report.outcomes.values()) >= 10_000
