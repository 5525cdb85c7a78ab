import csv
import math
from itertools import product

import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptigraph.geometry import (
    Circle,
    Phase,
    Point,
    Polyline,
    Segment,
    Surface,
    distance_to_polyline,
    height_on_polyline,
)
from haptigraph.registration.loading import load_registration
from haptigraph.scene.relations import MEASURES

FLAT = Polyline(((-10.0, 0.0), (0.0, 0.0), (10.0, 0.0)))
FOUND = {"trocar": Point((0.0, 20.0))}


def measure(name, subject, object_, found=FOUND):
    return MEASURES[name].function(subject, object_, found)


def test_distance_to_a_point_is_euclidean():
    assert measure("distance_mm", Point((0.0, 0.0)), Point((3.0, 4.0))) == 5.0


def test_distance_to_a_surface_is_negative_beyond_it():
    assert measure("distance_mm", Point((1.0, 2.0)), FLAT) == 2.0
    assert measure("distance_mm", Point((1.0, -2.0)), FLAT) == -2.0
    assert measure("distance_mm", Point((1.0, 0.0)), FLAT) == 0.0


def test_radial_distance_is_from_the_axis_trocar_to_target():
    assert measure("radial_mm", Point((0.5, 3.0)), Point((0.0, 0.0))) == 0.5


def test_theta_is_between_shaft_and_axis():
    shaft = Segment((0.0, 20.0), (math.sin(math.radians(3)), 20 - math.cos(math.radians(3))))
    assert measure("theta_deg", shaft, Point((0.0, 0.0))) == pytest.approx(3.0)


def test_the_distance_of_a_polyline_is_that_of_its_nearest_vertex_even_beyond_the_surface():
    assert measure("distance_mm", Polyline(((1.0, 3.0), (2.0, 2.0))), FLAT) == 2.0
    assert measure("distance_mm", Polyline(((1.0, 3.0), (2.0, -1.0))), FLAT) == -1.0
    assert measure("distance_mm", Polyline(((1.0, 3.0), (2.0, 2.0))), FLAT, {}) is None


def test_clearance_is_between_shafts_and_0_if_they_cross():
    shaft = Segment((0.0, 5.0), (0.0, 0.0))
    assert measure("clearance_mm", shaft, Segment((2.0, 3.0), (1.0, 1.0))) == 1.0
    assert measure("clearance_mm", shaft, Segment((2.0, 3.0), (-1.0, 1.0))) == 0.0


def test_aside_is_the_lateral_distance_to_a_region_seen_from_the_centre():
    found = {"eye_globe": Circle((0.0, 0.0), 12.0)}
    blood = Circle((0.0, -12.0), 1.5)
    assert measure("aside_mm", Point((1.0, -8.0)), blood, found) == -0.5
    assert measure("aside_mm", Point((4.0, -8.0)), blood, found) == 2.5
    assert measure("aside_mm", Point((0.0, 8.0)), blood, found) == 6.5
    assert measure("aside_mm", Point((1.0, -8.0)), blood, {}) is None


def test_every_entity_is_within_an_ongoing_phase():
    assert measure("elapsed_s", Point((1.0, 2.0)), Phase(3.5)) == 3.5


def test_the_distance_to_the_wall_is_positive_inside():
    globe = Circle((0.0, 0.0), 12.0)
    assert measure("wall_mm", Point((0.0, 10.0)), globe) == 2.0
    assert measure("wall_mm", Point((0.0, 13.0)), globe) == -1.0


@pytest.mark.parametrize("name", ["radial_mm", "theta_deg"])
def test_measures_to_the_axis_are_undefined_without_a_trocar(name):
    subject = Segment((0.0, 2.0), (0.0, 1.0)) if name == "theta_deg" else Point((0.0, 1.0))
    assert measure(name, subject, Point((0.0, 0.0)), {}) is None


SHAPES = {
    "point": Point((0.0, 1.0)),
    "segment": Segment((0.0, 2.0), (0.0, 1.0)),
    "circle": Circle((0.0, 0.0), 1.0),
    "polyline": FLAT,
    "surface": Surface((-1.0, 1.0), (-1.0, 1.0), ((0.1, 0.1), (0.1, 0.1))),
    "phase": Phase(1.0),
}


@pytest.mark.parametrize("name", MEASURES)
def test_a_measure_is_defined_for_the_shapes_that_it_supports_and_never_raises(name):
    found = {"trocar": Point((0.0, 20.0)), "needle_tip": SHAPES["point"], "eye_globe": SHAPES["circle"]}
    for (one, subject), (other, object_) in product(SHAPES.items(), repeat=2):
        lower = Surface((-1.0, 1.0), (-1.0, 1.0), ((-1.0, -1.0), (-1.0, -1.0)))
        found["rpe"] = lower if other == "surface" else Polyline(((-10.0, -1.0), (10.0, -1.0)))
        is_defined = measure(name, subject, object_, found) is not None
        assert is_defined or (one, other) not in MEASURES[name].shapes


def test_every_measure_ends_in_its_unit():
    assert all(name.rpartition("_")[2] in ("mm", "um", "deg", "percent", "s") for name in MEASURES)


def test_measures_agree_with_the_ground_truth_of_clips(clip):
    registration = load_registration(clip / "registration.toml")
    found = registration.anatomy
    with (clip / "truth.csv").open() as file:
        rows = [row for row in csv.DictReader(file) if row["visible"] == "1" and row["inside"] == "1"]
    for row in rows:
        tip = Point(registration.image.to_mm((float(row["tip_x_px"]), float(row["tip_y_px"]))))
        retina_mm = measure("distance_mm", tip, found["retina_surface"], found)
        target_mm = measure("distance_mm", tip, found["retina_target"], found)
        radial_mm = measure("radial_mm", tip, found["retina_target"], found)
        assert retina_mm == pytest.approx(float(row["tip_to_retina_mm"]), abs=0.06)
        assert target_mm == pytest.approx(float(row["tip_to_target_mm"]), abs=0.08)
        assert radial_mm == pytest.approx(float(row["radial_mm"]), abs=0.03)


# --- layers of a B-scan

ILM = Polyline(((-1.0, 0.1), (0.0, 0.0), (1.0, 0.1)))
RPE = Polyline(((-1.0, -0.2), (0.0, -0.3), (1.0, -0.2)))


@given(st.floats(-0.9, 0.9), st.floats(-0.6, 0.6))
def test_a_gap_is_a_distance_whose_sign_is_the_side(x, y):
    tip = Point((x, y))
    gap_um = MEASURES["gap_um"].function(tip, ILM, {})
    assert abs(gap_um) == pytest.approx(1e3 * distance_to_polyline((x, y), ILM))
    if abs(gap_um) > 1e-6:
        assert (gap_um > 0) == (y > height_on_polyline(x, ILM))


@given(st.floats(-1.0, 1.0))
def test_a_point_on_a_layer_is_above_it(x):
    """The gap is +0, never -0, so that "at_least = 0" and the sign in a sentence agree."""
    flat = Polyline(((-1.0, 0.0), (1.0, 0.0)))
    gap_um = measure("gap_um", Point((x, 0.0)), flat)
    assert gap_um == 0
    assert math.copysign(1, gap_um) == 1


@given(st.floats(-0.9, 0.9), st.floats(0.0, 1.0))
def test_depth_is_the_fraction_of_the_distance_along_the_beam(x, fraction):
    top, bottom = height_on_polyline(x, ILM), height_on_polyline(x, RPE)
    tip = Point((x, top + fraction * (bottom - top)))
    found = {"needle_tip": tip, "ilm": ILM, "rpe": RPE}
    assert MEASURES["depth_percent"].function(tip, ILM, found) == pytest.approx(100 * fraction, abs=1e-6)
    assert MEASURES["thickness_um"].function(ILM, RPE, found) == pytest.approx(300)


@pytest.mark.parametrize("above_mm", [0.0, -0.1])
def test_depth_is_undefined_where_the_retina_has_no_thickness(above_mm):
    tip = Point((0.0, 0.2))
    surface = Polyline(tuple((x, y + above_mm) for x, y in RPE.points_mm))
    found = {"needle_tip": tip, "ilm": surface, "rpe": RPE}
    assert measure("depth_percent", tip, surface, found) is None
    assert measure("thickness_um", surface, RPE, found) == pytest.approx(1e3 * above_mm)


def test_depth_and_thickness_are_undefined_without_the_entities_that_they_require():
    tip = Point((0.0, 0.0))
    assert MEASURES["depth_percent"].function(tip, ILM, {"needle_tip": tip}) is None
    assert MEASURES["thickness_um"].function(ILM, RPE, {}) is None


def test_the_direction_of_a_polyline_does_not_change_its_height():
    reversed_ilm = Polyline(ILM.points_mm[::-1])
    for x in (-2.0, -0.5, 0.3, 2.0):
        assert height_on_polyline(x, reversed_ilm) == height_on_polyline(x, ILM)


@pytest.mark.parametrize(("lean_deg", "incidence_deg"), [(0, 0), (35, 35), (90, 90), (145, 35)])
def test_incidence_is_the_angle_to_the_surface(lean_deg, incidence_deg):
    flat = Polyline(((-1.0, 0.0), (1.0, 0.0)))
    lean = math.radians(lean_deg)
    shaft = Segment((-math.cos(lean), math.sin(lean)), (0.0, 0.0))
    assert MEASURES["incidence_deg"].function(shaft, flat, {}) == pytest.approx(incidence_deg, abs=1e-9)


def test_incidence_and_thickness_are_those_of_the_column_of_the_tip():
    tip_mm = (-0.6, 0.9)
    slope = Polyline(((-2.0, -2.0), (0.0, 0.0), (2.0, 0.0)))
    flat = Polyline(((-2.0, -3.0), (2.0, -3.0)))
    assert measure("incidence_deg", Segment((-0.6, 2.9), tip_mm), slope) == pytest.approx(45)
    assert measure("thickness_um", slope, flat, {"needle_tip": Point(tip_mm)}) == pytest.approx(2400)


# --- surfaces of a volume


def plane(at_mm: float, right: float, towards: float) -> Surface:
    """A plane of given slopes, over 4 x 4 mm."""
    grid = tuple(n / 4 for n in range(-8, 9))
    rows = tuple(tuple(at_mm + right * x + towards * z for x in grid) for z in grid)
    return Surface(grid, grid, rows)


within = st.floats(-1.0, 1.0)


@given(at_mm=within, right=within, towards=within, x=within, y=within, z=within)
def test_the_gap_to_a_plane_is_the_distance_along_its_normal(at_mm, right, towards, x, y, z):
    tip = Point((x, y), z)
    expected_um = 1000 * (y - at_mm - right * x - towards * z) / math.sqrt(1 + right**2 + towards**2)
    assert measure("gap_um", tip, plane(at_mm, right, towards)) == pytest.approx(expected_um, abs=1e-6)


@given(right=within, along=st.tuples(within, st.floats(-1.0, -0.1)), x=within, z=within)
def test_a_surface_that_is_the_same_in_every_b_scan_is_measured_as_in_one(right, along, x, z):
    flat, surface = Polyline(((-2.0, -2 * right), (2.0, 2 * right))), plane(0.0, right, 0.0)
    tip, below = Point((x, 0.3), z), plane(-0.4, right, 0.0)
    found = {"needle_tip": tip, "rpe": below}
    flat_found = {"needle_tip": tip, "rpe": Polyline(((-2.0, -0.4 - 2 * right), (2.0, -0.4 + 2 * right)))}
    for name in ("gap_um", "depth_percent"):
        flat_value = measure(name, tip, flat, flat_found)
        assert measure(name, tip, surface, found) == pytest.approx(flat_value, rel=1e-6, abs=1e-6)
    shaft = Segment((x - along[0], -along[1]), (x, 0.0), z, z)
    incidence_deg = measure("incidence_deg", shaft, flat, {})
    assert measure("incidence_deg", shaft, surface, {}) == pytest.approx(incidence_deg, abs=1e-6)
    assert measure("thickness_um", surface, below, found) == pytest.approx(400)


def test_a_shaft_out_of_the_section_is_less_steep_than_it_seems():
    shaft = Segment((0.0, 1.0), (0.0, 0.0), 1.0, 0.0)
    assert measure("incidence_deg", shaft, plane(0.0, 0.0, 0.0), {}) == pytest.approx(45)
    assert measure("incidence_deg", shaft, FLAT, {}) == pytest.approx(90)


@pytest.mark.parametrize("z_mm", [-0.25, 0.25])
def test_out_of_plane_is_the_distance_from_the_middle_section_on_either_side(z_mm):
    assert measure("out_of_plane_um", Point((0.4, 0.1), z_mm), plane(0.0, 0.0, 0.0)) == pytest.approx(250)


def test_the_distance_between_points_counts_their_z():
    assert measure("distance_mm", Point((0.0, 3.0), 1.0), Point((4.0, 0.0), 13.0)) == pytest.approx(13)
