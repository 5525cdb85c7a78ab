"""What can be tested of the script for 3D Slicer without Slicer: its text, its models, its devices."""

import importlib.util

import numpy as np
import pytest
from paths import ROOT

from haptigraph.bridges import openigtlink
from haptigraph.bridges.needle_pose import needle_matrix
from haptigraph.geometry import Point, Segment
from haptigraph.messages import TIP_NOT_VISIBLE, UNKNOWN

PATH = ROOT / "examples" / "slicer" / "show_run.py"


@pytest.fixture(scope="module")
def script():
    specification = importlib.util.spec_from_file_location("show_run", PATH)
    module = importlib.util.module_from_spec(specification)
    specification.loader.exec_module(module)
    return module


def test_names_of_devices_and_states_are_those_of_the_bridge(script):
    assert (script.TRANSFORM, script.STATE) == (openigtlink.NEEDLE, openigtlink.STATE)
    assert set(script.WITHOUT_TIP) == {UNKNOWN, TIP_NOT_VISIBLE}
    assert script.parse_arguments([]).port == openigtlink.PORT


def test_options_of_slicer_itself_are_ignored(script):
    options = script.parse_arguments(["--no-splash", "--port", "7", "--globe-mm", "0"])
    assert (options.host, options.port, options.globe_mm) == ("localhost", 7, 0.0)


def test_a_needle_is_shown_only_where_it_is_known_to_be(script):
    assert script.what_to_show("retinal_contact", True, True) == ("retinal contact", True)
    assert script.what_to_show("retinal_contact", True, False) == ("retinal contact", False)
    for state in (UNKNOWN, TIP_NOT_VISIBLE):
        assert script.what_to_show(state, True, True) == (state.replace("_", " "), False)
    assert script.what_to_show(None, True, False) == ("connected; nothing received yet", False)
    assert script.what_to_show("retinal_contact", False, True) == ("not connected to haptigraph", False)


def points_of(poly_data):
    points = poly_data.GetPoints()
    return np.array([points.GetPoint(index) for index in range(points.GetNumberOfPoints())])


def test_the_needle_model_under_the_transform_lies_along_the_shaft(script):
    pytest.importorskip("vtk")
    model = points_of(script.needle_model())
    assert model[:, 2].max() == pytest.approx(0.0)
    assert np.hypot(model[:, 0], model[:, 1]).max() == pytest.approx(script.DIAMETER_MM / 2, rel=1e-3)
    line, tip = Segment((2.0, 10.0), (1.0, -4.0)), Point((1.0, -4.0))
    in_eye = np.c_[model, np.ones(len(model))] @ np.array(needle_matrix(line, tip)).T
    assert np.linalg.norm(in_eye - (1.0, -4.0, 0.0), axis=1).min() == pytest.approx(0.0, abs=1e-5)
    along = np.array([-1.0, -14.0, 0.0]) / np.hypot(1.0, 14.0)
    off_axis_mm = np.linalg.norm(np.cross(in_eye - (1.0, -4.0, 0.0), along), axis=1)
    assert off_axis_mm.max() < script.DIAMETER_MM / 2 + 1e-3
    assert ((in_eye - (1.0, -4.0, 0.0)) @ along).min() == pytest.approx(-script.NEEDLE_MM, abs=1e-3)


def test_the_globe_is_a_sphere_about_the_origin(script):
    pytest.importorskip("vtk")
    assert np.linalg.norm(points_of(script.globe_model(24.0)), axis=1) == pytest.approx(12.0)
