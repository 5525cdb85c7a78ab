import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from haptigraph.errors import BadInput
from haptigraph.geometry import distance_to_polyline
from haptigraph.registration.retarget import with_target
from haptigraph.sim.phantom import Phantom
from haptigraph.sim.scenario import load_scenario


@settings(max_examples=20)
@given(st.floats(-12, 12))
def test_a_moved_target_is_on_the_retina_at_the_arc_length_and_nothing_else_moves(registration, along_mm):
    moved = with_target(registration, along_mm)
    x, y = moved.target.at_mm
    assert math.atan2(x, -y) * registration.globe.radius_mm == pytest.approx(along_mm, abs=0.01)
    assert distance_to_polyline(moved.target.at_mm, registration.retina) < 0.01
    assert moved.trocar.at_mm == pytest.approx(registration.trocar.at_mm, abs=1e-3)
    assert moved.globe.radius_mm == registration.globe.radius_mm
    assert with_target(moved, along_mm).target.at_mm == pytest.approx(moved.target.at_mm, abs=1e-3)


def test_a_target_beyond_the_retina_is_refused(registration):
    with pytest.raises(
        BadInput, match=r"source\.target_mm: a target at 30 mm is beyond the registered retina"
    ):
        with_target(registration, 30.0)


@pytest.mark.parametrize("along_mm", [-4.0, 0.0, 4.5])
def test_a_phantom_places_its_target_at_the_same_arc_length(quick, along_mm):
    phantom = Phantom(load_scenario(quick, along_mm))
    x, y = phantom.eye.target_mm
    assert math.atan2(x, -y) * phantom.eye.radius_mm == pytest.approx(along_mm)
