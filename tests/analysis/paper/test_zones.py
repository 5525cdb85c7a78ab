"""Trigger zones: the states that the rules give places of the tip, and no others."""

import pytest
from msgspec.structs import replace

from haptigraph.analysis.paper.zones import STEP_PX, zones
from haptigraph.geometry import Vec, norm, rotate, subtract
from haptigraph.messages import Observation
from haptigraph.perception.eye_view import IoctView


@pytest.fixture(scope="module")
def view(registration):
    return IoctView(registration, 160)


@pytest.fixture(scope="module")
def priorities(procedure, registration, view):
    return zones(procedure, registration, view, Observation(0, dict(registration.anatomy)))


def state_at(procedure, priorities, view, at_mm: Vec) -> str:
    column, row = (round(part / STEP_PX) for part in view.to_px(at_mm))
    return procedure.states[priorities[row, column]].name


def along(registration, turn_deg: float, share: float) -> Vec:
    """Return a place on a line through the trocar, turned from that to the target."""
    trocar = registration.trocar.at_mm
    x, y = rotate(subtract(registration.target.at_mm, trocar), turn_deg)
    return trocar[0] + share * x, trocar[1] + share * y


@pytest.mark.parametrize(
    ("turn_deg", "share", "state"),
    [
        (0, 0.5, "aligned_intraocular_navigation"),
        (8, 0.5, "misaligned_intraocular_navigation"),
        (0, 0.9, "aligned_retinal_approach"),
        (6, 0.9, "misaligned_retinal_approach"),
        (0, 0.99, "target_hit"),
    ],
)
def test_a_place_has_the_state_of_its_tip(procedure, registration, view, priorities, turn_deg, share, state):
    assert state_at(procedure, priorities, view, along(registration, turn_deg, share)) == state


def test_beside_the_target_the_retina_has_the_zone_of_contact(procedure, registration, view, priorities):
    points = registration.retina.points_mm
    for x, y in (points[len(points) // 4], points[3 * len(points) // 4]):
        assert state_at(procedure, priorities, view, (0.97 * x, 0.97 * y)) == "retinal_contact"


def test_outside_the_eye_there_is_no_zone(registration, view, priorities):
    for row, column in ((0, 0), (0, -1), (-1, 0), (-1, -1)):
        assert priorities[row, column] == -1
    inside = sum(priority >= 0 for priority in priorities.ravel())
    area_mm2 = inside * (2 * view.half_mm * STEP_PX / view.size_px) ** 2
    assert area_mm2 == pytest.approx(3.1416 * registration.globe.radius_mm**2, rel=0.03)
    assert norm(registration.globe.center_mm) == 0


def test_zones_show_where_a_state_is_whatever_time_it_takes(procedure, registration, view, priorities):
    states = tuple(
        replace(one, enter_after_ms=200.0) if one.kind == "guidance" else one for one in procedure.states
    )
    seen = Observation(0, dict(registration.anatomy))
    assert (zones(replace(procedure, states=states), registration, view, seen) == priorities).all()
