import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

from haptigraph.geometry import Point, Polyline, Surface
from haptigraph.grammar import OFF, ForceField
from haptigraph.graph import SceneGraph
from haptigraph.haptics.force.fixture import Fixture, elastic_mj, fixtures_of, force_n, tip_of, to_hand
from haptigraph.messages import Conclusion, HapticCommand, Observation, Step

CONE = Fixture("cone", (0.0, 12.0, 0.0), (0.0, -1.0, 0.0), 1.7, 0.3, limit_n=2.0)
PLANE = Fixture("plane", (0.0, -11.0, 0.0), (0.0, 1.0, 0.0), stiffness_n_per_mm=1.0, limit_n=3.0)
VISCOUS = Fixture("viscous", damping_n_s_per_mm=0.01, limit_n=1.0)
REST = (0.0, 0.0, 0.0)
FIELDS = {
    "cone": ForceField("guide", "cone", 0.3, 0.002, 2.0, half_angle_deg=1.7),
    "plane": ForceField("floor", "plane", 1.0, 0.002, 3.0, height_mm=0.9),
    "viscous": ForceField("drag", "viscous", damping_n_s_per_mm=0.01),
}
coordinate = st.floats(-30, 30)
position = st.tuples(coordinate, coordinate, coordinate)
walls = st.builds(
    Fixture,
    st.sampled_from(("cone", "plane")),
    position,
    st.sampled_from(((0.0, -1.0, 0.0), (0.6, 0.8, 0.0), (0.0, 0.6, -0.8))),
    st.floats(0.5, 40),
    st.floats(0.05, 5),
    st.floats(0, 0.1),
    st.floats(0.1, 10),
    st.booleans(),
)


def step_of(found, *kinds) -> Step:
    command = HapticCommand(0, OFF, 0, tuple(FIELDS[kind] for kind in kinds))
    return Step(
        0, 0, Observation(0, found), SceneGraph(0, (), ()), Conclusion(0, "s", 0, "off", "because"), command
    )


def eye(tip_mm):
    arc = [math.radians(200 + angle) for angle in range(0, 141, 2)]
    retina = Polyline(tuple((12 * math.cos(angle), 12 * math.sin(angle)) for angle in arc))
    return {
        "needle_tip": Point(tip_mm),
        "trocar": Point((0.0, 12.0)),
        "retina_target": Point((0.0, -12.0)),
        "retina_surface": retina,
    }


def test_a_cone_pushes_at_right_angles_to_its_surface():
    x, y, z = force_n(CONE, (3.0, 0.0, 0.0), REST)
    depth_mm = 3 * math.cos(math.radians(1.7)) - 12 * math.sin(math.radians(1.7))
    assert math.hypot(x, y) == pytest.approx(0.3 * depth_mm)
    assert (x < 0, z) == (True, 0.0)
    assert math.degrees(math.atan2(-y, -x)) == pytest.approx(1.7)


def test_inside_a_cone_and_above_a_plane_nothing_pushes():
    assert force_n(CONE, (0.3, 0.0, 0.0), (50.0, 0.0, 0.0)) == REST
    assert force_n(PLANE, (5.0, -10.9, 0.0), (0.0, -100.0, 0.0)) == REST


def test_a_plane_pushes_up_and_never_holds_back():
    damped = replace(PLANE, damping_n_s_per_mm=0.01)
    assert force_n(PLANE, (0.0, -12.0, 0.0), REST) == pytest.approx((0.0, 1.0, 0.0))
    assert force_n(damped, (0.0, -12.0, 0.0), (0.0, -50.0, 0.0)) == pytest.approx((0.0, 1.5, 0.0))
    assert force_n(damped, (0.0, -12.0, 0.0), (0.0, 200.0, 0.0)) == REST


def test_viscous_resists_every_motion_up_to_its_limit():
    assert force_n(VISCOUS, REST, (30.0, -40.0, 0.0)) == pytest.approx((-0.3, 0.4, 0.0))
    assert force_n(VISCOUS, REST, (0.0, 0.0, 900.0)) == pytest.approx((0.0, 0.0, -1.0))
    assert force_n(VISCOUS, REST, REST) == REST


def test_a_section_leaves_the_third_axis_free():
    flat = replace(CONE, is_planar=True)
    assert force_n(flat, (0.0, 0.0, 9.0), (0.0, 0.0, 9.0)) == REST
    assert force_n(CONE, (0.0, 0.0, 9.0), REST)[2] < 0


@given(walls, position, position)
def test_no_wall_exceeds_its_limit_or_holds_back(wall, position_mm, velocity_mm_s):
    pushed = force_n(wall, position_mm, velocity_mm_s)
    at_rest = force_n(wall, position_mm, REST)
    assert math.hypot(*pushed) <= wall.limit_n * (1 + 1e-9)
    assert sum(a * b for a, b in zip(pushed, at_rest, strict=True)) >= -1e-12


@given(walls, position)
def test_a_wall_is_the_gradient_of_its_stored_energy(wall, position_mm):
    step_mm = 1e-5
    pushed = force_n(wall, position_mm, REST)
    for axis in range(3):
        ahead, behind = list(position_mm), list(position_mm)
        ahead[axis] += step_mm
        behind[axis] -= step_mm
        slope = (elastic_mj(wall, tuple(ahead)) - elastic_mj(wall, tuple(behind))) / (2 * step_mm)
        assert pushed[axis] == pytest.approx(-slope, abs=2e-3)


@given(position, position, st.floats(0.05, 1.0), position)
def test_the_hand_feels_what_the_tip_would_scaled_in_position_only(tip_mm, hand_mm, scale, moved_mm):
    placed = to_hand(CONE, tip_mm, hand_mm, scale)
    hand_now = tuple(at + by for at, by in zip(hand_mm, moved_mm, strict=True))
    tip_now = tuple(at + scale * by for at, by in zip(tip_mm, moved_mm, strict=True))
    deep = replace(CONE, stiffness_n_per_mm=CONE.stiffness_n_per_mm / scale)
    assert force_n(placed, hand_now, REST) == pytest.approx(force_n(deep, tip_now, REST), abs=1e-6)


def test_the_cone_of_a_step_is_about_trocar_and_target():
    (cone,) = fixtures_of(step_of(eye((1.0, 0.0)), "cone"))
    assert (cone.kind, cone.point_mm, cone.direction) == ("cone", (0.0, 12.0, 0.0), (0.0, -1.0, 0.0))
    assert (cone.half_angle_deg, cone.stiffness_n_per_mm, cone.limit_n) == (1.7, 0.3, 2.0)
    assert cone.is_planar


@pytest.mark.parametrize("depth_mm", [-11.0, -11.9, -11.999, -12.0, -12.3])
def test_the_floor_lies_above_the_retina_on_whichever_side_the_tip_is(depth_mm):
    (floor,) = fixtures_of(step_of(eye((0.0, depth_mm)), "plane"))
    assert floor.direction == pytest.approx((0.0, 1.0, 0.0), abs=0.02)
    assert floor.point_mm[1] == pytest.approx(-12 + 0.9, abs=0.01)
    pushed = force_n(floor, (0.0, depth_mm, 0.0), REST)[1]
    assert pushed == pytest.approx(min(max(-11.1 - depth_mm, 0.0), 3.0), abs=0.01)


def test_the_floor_in_a_volume_follows_the_slope_in_depth():
    retina = Surface((-3.0, 3.0), (-3.0, 3.0), ((-1.3, -1.3), (-0.7, -0.7)))  # y grows by 0.1 per mm of z
    (floor,) = fixtures_of(step_of({"needle_tip": Point((0.0, 0.5), 1.0), "retina_surface": retina}, "plane"))
    assert floor.direction == pytest.approx((0.0, 0.995, -0.0995), abs=1e-3)
    assert force_n(replace(floor, limit_n=9.0), (0.0, -0.9, 1.0), REST)[1] > 0.85
    assert not floor.is_planar


def test_without_a_tip_or_its_anatomy_there_is_no_fixture():
    found = eye((0.0, 0.0))
    assert fixtures_of(step_of({**found, "needle_tip": Polyline(((0.0, 0.0), (1.0, 1.0)))}, "viscous")) == ()
    del found["retina_surface"], found["trocar"]
    assert fixtures_of(step_of(found, "cone", "plane")) == ()
    assert [one.kind for one in fixtures_of(step_of(found, "viscous", "plane"))] == ["viscous"]


def test_the_tip_of_a_step_is_where_the_hand_is_mapped_from():
    assert tip_of(step_of({"needle_tip": Point((1.0, 2.0), 3.0)})) == (1.0, 2.0, 3.0)
    assert tip_of(step_of({})) is None
