"""Whatever the hand does below its speed, and whichever force acts within the delay, the content stays positive."""

import random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from haptigraph.haptics.force.tank import CAPACITY_MJ, EnergyTank

MS = 1_000_000
SPEED_MM_S = 200.0


def shortened(force, most):
    size = sum(part * part for part in force) ** 0.5
    return tuple(part * min(most / size, 1.0) if size else 0.0 for part in force)


@given(st.integers(0, 2**32), st.sampled_from((0, 3, 10, 50)), st.booleans())
@settings(max_examples=40, deadline=None)
def test_an_adversary_never_empties_it(seed, delay_ms, is_hostile):
    """At each moment the adversary picks the force of those that may act, and the motion that gains most."""
    rng, tank, sent, given_mj, now = random.Random(seed), EnergyTank(SPEED_MM_S, 2.0), [], 0.0, 0
    stored = CAPACITY_MJ
    for _ in range(150):
        elapsed = round(rng.uniform(0.2, 2.0) * MS)
        begin, now = now, now + elapsed
        may_act = [force for force, until in sent if until is None or until + delay_ms * MS > begin]
        moved = (0.0, 0.0, 0.0)
        if may_act[:-1]:  # the newest is only passed on with this exchange
            force = max(may_act[:-1], key=lambda one: sum(part * part for part in one))
            size = sum(part * part for part in force) ** 0.5
            reach = SPEED_MM_S * elapsed / 1e9 * (1.0 if is_hostile else rng.uniform(-1, 1))
            moved = tuple(part / size * reach for part in force) if size else moved
            given_mj += max(sum(f * m for f, m in zip(one, moved, strict=True)) for one in may_act[:-1])
        tank.account(moved, elapsed, now, delay_ms * MS, 1e9)
        stored = min(stored, tank.content_mj)
        wanted = tuple(rng.gauss(0, 3) for _ in range(3))
        force = shortened(wanted, tank.admitted_n(now, delay_ms * MS))
        tank.send(force)
        # A force ends when the exchange after the next one replaces it.
        sent = [
            (one, now if until is None and number == len(sent) - 2 else until)
            for number, (one, until) in enumerate(sent)
        ]
        sent.append((force, None))
    assert stored > -1e-9
    assert given_mj <= CAPACITY_MJ + 1e-9


def test_what_the_hand_puts_in_is_kept_up_to_capacity_and_stored_energy():
    tank = EnergyTank(SPEED_MM_S, 2.0)
    for number in range(1, 5):
        tank.account((-0.1, 0.0, 0.0), MS, number * MS, 0, 0.05)
        tank.send((1.0, 0.0, 0.0))
    assert tank.content_mj == pytest.approx(CAPACITY_MJ + 0.05)


def test_an_unknown_motion_costs_the_worst():
    tank = EnergyTank(SPEED_MM_S, 2.0)
    tank.send((0.0, 2.0, 0.0))
    tank.account((0.0, 0.0, 0.0), MS, MS, 0, 0.0)  # from here on it acts
    tank.account(None, MS, 2 * MS, 0, 0.0)
    assert tank.content_mj == pytest.approx(CAPACITY_MJ - 2.0 * SPEED_MM_S * 1e-3)


def test_a_longer_delay_admits_less():
    admitted = [EnergyTank(SPEED_MM_S, 2.0).admitted_n(0, delay_ms * MS) for delay_ms in (0, 10, 50)]
    assert admitted == pytest.approx([CAPACITY_MJ / (SPEED_MM_S * ms * 1e-3) for ms in (2, 14, 54)])


def test_the_devices_own_damping_fills_it():
    tank = EnergyTank(SPEED_MM_S, 2.0, damping_n_s_per_mm=0.001)
    tank.content_mj = 1.0
    tank.account((0.1, 0.0, 0.0), MS, MS, 0, 0.0)
    assert tank.content_mj == pytest.approx(1.0 + 0.001 * 100.0 * 0.1)
