import math
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptigraph.geometry import (
    Polyline,
    Segment,
    angle_between_deg,
    crosses_polyline,
    distance_between,
    distance_to_line,
    distance_to_polyline,
    nearest_on_polyline,
    norm,
    rotate,
    subtract,
    unit,
)
from haptigraph.projection import Homography, ImageGeometry

coordinate = st.floats(-50, 50)
vector = st.tuples(coordinate, coordinate).filter(lambda v: norm(v) > 1e-3)
angle_deg = st.floats(-179, 179)
ARC = Polyline(tuple((12 * math.sin(a / 20), -12 * math.cos(a / 20)) for a in range(-25, 26)))


@given(vector, angle_deg)
def test_rotation_preserves_length_and_rotates_by_its_angle(v, angle):
    rotated = rotate(v, angle)
    assert norm(rotated) == pytest.approx(norm(v))
    assert angle_between_deg(v, rotated) == pytest.approx(abs(angle), abs=1e-6)


@given(vector, vector, vector, vector, st.floats(0, 1), st.floats(0, 1))
def test_no_two_points_of_two_segments_are_nearer_than_their_distance(a, b, c, d, fraction, other_fraction):
    one, other = Segment(a, b), Segment(c, d)
    point = a[0] + fraction * (b[0] - a[0]), a[1] + fraction * (b[1] - a[1])
    other_point = c[0] + other_fraction * (d[0] - c[0]), c[1] + other_fraction * (d[1] - c[1])
    assert distance_between(one, other) <= norm(subtract(point, other_point)) + 1e-9
    assert distance_between(one, other) == distance_between(other, one)


@given(vector, st.floats(1e-7, 1e-3))
def test_small_angles_are_accurate(v, angle):
    assert angle_between_deg(v, rotate(v, angle)) == pytest.approx(angle, rel=1e-4)


@given(vector, vector)
def test_angle_is_symmetric_and_between_0_and_180_degrees(u, v):
    assert angle_between_deg(u, v) == pytest.approx(angle_between_deg(v, u))
    assert 0 <= angle_between_deg(u, v) <= 180


def test_a_zero_vector_has_no_direction():
    with pytest.raises(ValueError, match="no direction"):
        unit((0.0, 0.0))


@given(vector, st.floats(-3, 3), st.floats(0, 5))
def test_distance_to_a_line_is_independent_of_the_position_along_it(direction, along, across):
    u = unit(direction)
    point = along * u[0] - across * u[1], along * u[1] + across * u[0]
    assert distance_to_line(point, (0.0, 0.0), direction) == pytest.approx(across, abs=1e-9)


@given(st.floats(-50, 50), st.floats(0, 30))
def test_distance_to_an_arc_is_the_difference_of_the_radii(angle, radius):
    point = radius * math.sin(math.radians(angle)), -radius * math.cos(math.radians(angle))
    assert distance_to_polyline(point, ARC) == pytest.approx(abs(12 - radius), abs=0.02)


def test_distance_beyond_the_end_of_a_polyline_is_to_its_end():
    line = Polyline(((0.0, 0.0), (1.0, 0.0), (2.0, 0.0)))
    assert distance_to_polyline((5.0, 4.0), line) == 5.0


@given(st.floats(-65, 65), st.floats(0.01, 11.9), st.floats(12.05, 30))
def test_a_segment_crosses_an_arc_exactly_if_it_ends_outside(angle, near, far):
    direction = math.sin(math.radians(angle)), -math.cos(math.radians(angle))
    inside = near * direction[0], near * direction[1]
    outside = far * direction[0], far * direction[1]
    assert not crosses_polyline((0.0, 0.0), inside, ARC)
    assert crosses_polyline((0.0, 0.0), outside, ARC)


@given(st.lists(vector, min_size=2, max_size=8), vector, vector)
def test_a_segment_crosses_a_polyline_exactly_if_it_crosses_one_of_its_segments(points, start, end):
    pairs = [Polyline(pair) for pair in pairwise(points)]
    crossed = [crosses_polyline(start, end, pair) for pair in pairs]
    assert crosses_polyline(start, end, Polyline(tuple(points))) == any(crossed)


def test_a_segment_through_a_vertex_crosses():
    line = Polyline(((-1.0, 0.0), (0.0, 0.0), (1.0, 0.0)))
    assert crosses_polyline((0.0, 1.0), (0.0, -1.0), line)
    assert not crosses_polyline((3.0, 1.0), (3.0, -1.0), line)


@given(
    st.tuples(st.floats(0, 2000), st.floats(0, 2000)),
    st.floats(0.005, 0.5),
    st.booleans(),
    st.tuples(st.floats(-20, 20), st.floats(-20, 20)),
)
def test_to_mm_and_to_px_are_inverse(center, mm_per_px, mirrored, at_mm):
    image = ImageGeometry(center, mm_per_px, mirrored)
    assert image.to_mm(image.to_px(at_mm)) == pytest.approx(at_mm, abs=1e-6)


def test_eye_frame_is_right_and_up_as_the_surgeon_sees_it():
    plain = ImageGeometry((100.0, 50.0), 0.1, mirrored=False)
    mirrored = ImageGeometry((100.0, 50.0), 0.1, mirrored=True)
    assert plain.to_mm((110.0, 30.0)) == pytest.approx((1.0, 2.0))
    assert mirrored.to_mm((110.0, 30.0)) == pytest.approx((-1.0, 2.0))


@given(vector, vector)
def test_subtraction_inverts_addition(a, b):
    d = subtract(a, b)
    assert (b[0] + d[0], b[1] + d[1]) == pytest.approx(a)


@given(vector)
def test_the_nearest_point_is_on_the_polyline_at_its_distance(point):
    nearest = nearest_on_polyline(point, ARC)
    assert distance_to_polyline(nearest, ARC) == pytest.approx(0, abs=1e-9)
    assert norm(subtract(point, nearest)) == pytest.approx(distance_to_polyline(point, ARC))


@given(vector, st.floats(-3e-4, 3e-4), st.floats(-3e-4, 3e-4))
def test_to_mm_and_to_px_are_inverse_for_a_tilted_camera(at_mm, right, down):
    tilt = Homography(((0.98, 0.01, 4.0), (0.02, 1.03, -7.0), (right, down, 1.0)))
    image = ImageGeometry((320.0, 200.0), 0.1, mirrored=True, frontal_from_image=tilt)
    assert image.to_mm(image.to_px(at_mm)) == pytest.approx(at_mm, abs=1e-6)


def test_a_singular_homography_has_no_inverse():
    with pytest.raises(ValueError, match="no inverse"):
        _ = Homography(((1.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, 1.0))).inverse
