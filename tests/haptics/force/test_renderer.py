import math
from itertools import pairwise

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec.structs import replace

from haptigraph.haptics.force.fixture import Fixture
from haptigraph.haptics.force.interface import HandReading
from haptigraph.haptics.force.renderer import (
    MAX_RISE_N_PER_S,
    RELEASE_MS,
    RESTART_MS,
    SOFT_START_MS,
    ForceRenderer,
)
from haptigraph.haptics.force.simulated import SimulatedForce
from haptigraph.haptics.force.tank import CAPACITY_MJ

MS = 1_000_000
IMAGE_NS = 33 * MS
WALL = Fixture("plane", direction=(0.0, 1.0, 0.0), stiffness_n_per_mm=1.0, limit_n=2.0)
ZERO = (0.0, 0.0, 0.0)
DEEP = (0.0, -1.0, 0.0)


class Rig:
    """A renderer, cycle by cycle of 1 ms, with a hand at rest."""

    def __init__(self, *fixtures: Fixture, **limits: float):
        self.renderer = ForceRenderer(SimulatedForce.capabilities, **limits)
        self.now_ns = self.due_ns = 10**9
        self.fixtures = fixtures
        self.force_n = ZERO

    def run(self, ms: int, position_mm=DEEP, velocity_mm_s=ZERO, *, engaged=True, age_ms=0, takes=True):
        sizes = []
        for _ in range(ms):
            self.now_ns += MS
            if takes and self.now_ns >= self.due_ns:
                self.renderer.take(self.fixtures, self.now_ns, self.now_ns)
                self.due_ns = self.now_ns + IMAGE_NS
            reading = HandReading(self.now_ns - age_ms * MS, position_mm, velocity_mm_s, engaged)
            self.force_n = self.renderer.step(reading, self.now_ns)
            sizes.append(math.hypot(*self.force_n))
        return sizes


@pytest.fixture
def rig():
    """A rig that pushes with 1 N."""
    rig = Rig(WALL)
    rig.run(400)
    assert rig.force_n == pytest.approx((0.0, 1.0, 0.0))
    return rig


def test_nothing_pushes_before_fixtures_and_then_the_force_grows_softly():
    rig = Rig(WALL)
    assert set(rig.run(50, takes=False)) == {0.0}
    assert rig.renderer.released_because == "no fixtures have arrived"
    sizes = rig.run(300)
    assert max(b - a for a, b in pairwise(sizes)) <= 2.0 / SOFT_START_MS + 1e-9  # two ramps
    assert sizes[-1] == pytest.approx(1.0)


FAULTS = {
    "a position that is not a number": {"position_mm": (0.0, math.nan, 0.0)},
    "infinite velocity": {"velocity_mm_s": (math.inf, 0.0, 0.0)},
    "jump": {"position_mm": (0.0, -9.0, 0.0)},
    "too fast": {"velocity_mm_s": (0.0, 0.0, 300.0)},
}


@pytest.mark.parametrize("fault", FAULTS.values(), ids=FAULTS)
def test_a_fault_releases_the_force_evenly_and_for_a_while(rig, fault):
    sizes = [1.0, *rig.run(1, **fault)]
    assert rig.renderer.problem
    sizes += rig.run(round(RELEASE_MS))
    assert sizes[-1] == 0.0
    assert max(a - b for a, b in pairwise(sizes)) <= 1.0 / RELEASE_MS + 1e-9
    assert set(rig.run(round(RESTART_MS) - 20)) == {0.0}
    sizes = rig.run(300)
    assert (rig.renderer.problem, rig.renderer.released_because) == ("", "")
    assert max(b - a for a, b in pairwise(sizes)) <= 1.0 / SOFT_START_MS + 1e-9
    assert sizes[-1] == pytest.approx(1.0)


def test_a_reading_that_no_longer_changes_releases_the_force_within_20_ms(rig):
    sizes = [rig.run(1, age_ms=age_ms)[0] for age_ms in range(1, 21)]
    assert sizes[:8] == pytest.approx([1.0] * 8)
    assert sizes[-1] == 0.0
    assert rig.renderer.problem == "the device's reading is 9 ms old"


def test_without_images_the_force_is_released_after_the_dead_man_time():
    rig = Rig(WALL, deadman_ms=60.0)
    rig.run(400)
    rig.renderer.take((WALL,), rig.now_ns, rig.now_ns)
    assert min(rig.run(59, takes=False)) > 0.99
    rig.run(round(RELEASE_MS) + 1, takes=False)
    assert rig.force_n == ZERO
    assert rig.renderer.problem == "no fixtures arrived for 60 ms"


def test_fixtures_of_an_old_image_count_as_none(rig):
    for _ in range(170):
        rig.renderer.take((WALL,), rig.now_ns - 200 * MS, rig.now_ns)
        rig.run(1, takes=False)
    assert rig.force_n == ZERO


def test_the_clutch_releases_the_force_without_a_fault(rig):
    assert rig.run(11, engaged=False)[-1] == 0.0
    assert (rig.renderer.problem, rig.renderer.released_because) == ("", "the clutch is released")
    assert rig.run(220)[-1] == pytest.approx(1.0)


def test_the_tank_is_refilled_only_after_the_clutch_was_released_for_long(rig):
    rig.renderer._tank.content_mj = 0.5
    rig.run(400, engaged=False)
    assert rig.renderer.tank_mj == 0.5
    rig.run(200, engaged=False)
    assert rig.renderer.tank_mj == CAPACITY_MJ


def test_a_loop_that_stopped_releases_the_force(rig):
    rig.now_ns += 100 * MS
    rig.run(1)
    assert rig.renderer.problem == "the force loop stopped for 101 ms"
    assert rig.run(11)[-1] == 0.0


def test_a_fault_of_the_device_releases_the_force_and_names_it(rig):
    rig.renderer.release("the device failed", rig.now_ns)
    assert rig.run(11)[-1] == 0.0
    assert rig.renderer.problem == "the device failed"


def test_a_state_without_force_fades_out_within_20_ms(rig):
    rig.renderer.take((), rig.now_ns, rig.now_ns)
    sizes = rig.run(20, takes=False)
    assert sizes[-1] == 0.0
    assert sizes[9] == pytest.approx(0.5)
    assert rig.renderer.released_because == ""


def test_a_jump_of_the_fixtures_is_not_a_knock(rig):
    rig.fixtures = (replace(WALL, point_mm=(0.0, 5.0, 0.0)),)
    rig.renderer.take(rig.fixtures, rig.now_ns, rig.now_ns)
    sizes = [1.0, *rig.run(40, takes=False)]
    assert max(b - a for a, b in pairwise(sizes)) <= MAX_RISE_N_PER_S / 1000 + 1e-9
    assert sizes[-1] == pytest.approx(2.0)


def test_what_a_person_set_limits_all_fixtures_together():
    rig = Rig(WALL, replace(WALL, stiffness_n_per_mm=3.0), max_force_n=0.7)
    assert max(rig.run(500)) == pytest.approx(0.7)


def test_the_stiffest_wall_depends_on_the_devices_delay():
    hard = replace(WALL, stiffness_n_per_mm=5.0)
    forces = []
    for delay_ms in (0.0, 10.0, 50.0):
        renderer = ForceRenderer(replace(SimulatedForce.capabilities, delay_ms=delay_ms))
        forces.append(renderer._damped(hard))
    assert [round(one.stiffness_n_per_mm, 2) for one in forces] == [5.0, 0.87, 0.19]
    assert all(one.damping_n_s_per_mm <= 0.0200001 for one in forces)


@given(st.lists(st.tuples(st.floats(-3, 3), st.floats(-3, 3), st.booleans()), min_size=5, max_size=40))
@settings(max_examples=30, deadline=None)
def test_the_same_calls_give_the_same_forces_within_the_limit(moves):
    def forces():
        rig = Rig(WALL)
        return [rig.run(8, (x, y, 0.0), engaged=engaged)[-1] for x, y, engaged in moves]

    first = forces()
    assert first == forces()
    assert max(first) <= WALL.limit_n + 1e-12
