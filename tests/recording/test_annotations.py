"""Annotations of images from a tilted camera, and of volumes."""

import math

import pytest

from haptigraph.geometry import Circle, Point, Segment
from haptigraph.projection import ImageGeometry, Slices
from haptigraph.recording.foxglove import Time, annotations
from haptigraph.registration.tilt import CameraTilt

SLANT = CameraTilt((320.0, 200.0), (0.1, -0.2), 2000.0, (319.5, 179.5))


def test_a_circle_in_a_tilted_image_is_annotated_as_an_ellipse():
    image = ImageGeometry((320.0, 200.0), 0.1, mirrored=False, frontal_from_image=SLANT.frontal_from_image)
    drawn = annotations(Time(0, 0), {"eye_globe": Circle((0.0, 0.0), 12.0)}, image, "")
    assert drawn.circles == ()
    (line,) = drawn.points
    assert (line.points[0].x, line.points[0].y) == pytest.approx((line.points[-1].x, line.points[-1].y))
    for point in line.points:
        assert math.hypot(*image.to_mm((point.x, point.y))) == pytest.approx(12.0, abs=1e-6)
    frontal = annotations(
        Time(0, 0), {"eye_globe": Circle((0.0, 0.0), 12.0)}, ImageGeometry((320.0, 200.0), 0.1, False), ""
    )
    assert len(frontal.circles) == 1
    assert frontal.points == ()


def test_in_a_volume_the_tip_is_annotated_in_its_b_scan():
    slices = Slices(11, 0.1, 200)
    image = ImageGeometry((99.5, 49.5), 0.01, mirrored=False, axial_mm_per_px=0.01, slices=slices)
    shaft = Segment((-0.5, 0.5), (0.2, 0.1), 0.4, 0.29)
    drawn = annotations(Time(0, 0), {"needle_tip": Point((0.2, 0.1), 0.29), "needle_line": shaft}, image, "")
    (circle,) = drawn.circles
    assert (circle.position.x, circle.position.y) == pytest.approx((8 * 200 + 99.5 + 20, 39.5))
    assert drawn.points == ()  # a line crosses B-scans
