import csv
import math

import pytest

from haptigraph.geometry import Circle, Point, Polyline, Segment
from haptigraph.perception.registration import load_registration
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


def test_the_wall_is_positive_inside():
    globe = Circle((0.0, 0.0), 12.0)
    assert measure("wall_mm", Point((0.0, 10.0)), globe) == 2.0
    assert measure("wall_mm", Point((0.0, 13.0)), globe) == -1.0


@pytest.mark.parametrize("name", ["radial_mm", "theta_deg"])
def test_without_a_trocar_there_is_no_axis(name):
    subject = Segment((0.0, 2.0), (0.0, 1.0)) if name == "theta_deg" else Point((0.0, 1.0))
    assert measure(name, subject, Point((0.0, 0.0)), {}) is None


@pytest.mark.parametrize("name", MEASURES)
def test_shapes_a_measure_is_not_made_for_give_none(name):
    assert measure(name, FLAT, FLAT) is None


def test_every_measure_ends_in_its_unit():
    assert all(name.rpartition("_")[2] in ("mm", "deg") for name in MEASURES)


def test_measures_agree_with_the_truth_of_clips(clip):
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
