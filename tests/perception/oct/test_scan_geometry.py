"""Surfaces as they are reported: extended to the tip, less certain there, in millimetres."""

import numpy as np
import pytest
from scans.bscans import registration_of

from haptigraph.geometry import Polyline, height_on_polyline
from haptigraph.perception.oct.scan_geometry import Layers, ObservationBuilder, Shaft

LATERAL_MM, AXIAL_MM = 0.0078, 0.0033


def observation_of(tip_mm, factor=1.0, ilm_end_mm=1.0, slope=0.2, bent_mm=0.0):
    """A straight surface, visible from the image's border, and a tip at a lateral distance from that.

    The RPE is visible for 1 mm. Its last 0.2 mm are bent downwards, by `bent_mm` at their end, and so much less
    certain.
    """
    lateral_mm, axial_mm = LATERAL_MM / factor, AXIAL_MM / factor
    registration = registration_of(round(512 * factor), round(512 * factor), axial_mm, lateral_mm)
    x_mm = np.arange(0.02, 3.9, 0.04)
    ilm_px = (0.5 + slope * x_mm) / axial_mm
    sd_px = np.full(len(x_mm), 0.005 / axial_mm)
    deeper_px = bent_mm * np.clip((x_mm - 1.0) / 0.2 + 1, 0, 1) / axial_mm
    rpe_px, rpe_sd_px = ilm_px + 0.3 / axial_mm + deeper_px, np.hypot(sd_px, deeper_px)
    layers = Layers(x_mm / lateral_mm, ilm_px, x_mm <= ilm_end_mm, rpe_px, x_mm <= 1.0, sd_px, rpe_sd_px)
    shaft = Shaft((tip_mm / lateral_mm, 50.0), (0.0, 0.0), (0.6, 0.8), (1.0, 1.0), 0.1, 1.0)
    return ObservationBuilder(registration)(0, layers, shaft), registration.image


def observe(tip_mm, factor=1.0):
    """Return the ILM's height and standard deviation below the tip, its height at the border, and the rest."""
    observation, image = observation_of(tip_mm, factor)
    tip_x_mm = observation.found["needle_tip"].at_mm[0]
    sds = zip(observation.found["ilm"].points_mm, observation.sd_mm["ilm"], strict=True)
    sd_mm = height_on_polyline(tip_x_mm, Polyline(tuple((x, sd) for (x, _), sd in sds)))
    start_mm = height_on_polyline(image.to_mm((0.0, 0.0))[0], observation.found["ilm"])
    return height_on_polyline(tip_x_mm, observation.found["ilm"]), sd_mm, start_mm, observation


@pytest.mark.parametrize("tip_mm", [1.03, 1.07, 1.11])
def test_a_surface_reaches_below_the_tip_and_is_less_certain_there(tip_mm):
    y_mm, sd_mm, start_mm, observation = observe(tip_mm)
    assert start_mm - y_mm == pytest.approx(0.2 * (tip_mm - 0.02), abs=0.012)
    assert sd_mm == pytest.approx(np.hypot(0.005, 0.07 * (tip_mm - 0.98)), abs=0.002)
    assert len(observation.interpolated["ilm"]) == 1


@pytest.mark.parametrize("bent_mm", [0.0, 0.03])
@pytest.mark.parametrize("tip_mm", [1.2, 1.42])
def test_beyond_what_is_visible_the_rpe_is_parallel_to_the_ilm(tip_mm, bent_mm):
    found = observation_of(tip_mm, ilm_end_mm=2.0, bent_mm=bent_mm)[0].found
    x_mm = found["needle_tip"].at_mm[0]
    thickness_mm = height_on_polyline(x_mm, found["ilm"]) - height_on_polyline(x_mm, found["rpe"])
    assert thickness_mm == pytest.approx(0.3, abs=0.01)  # by the slope of its end: 0.05 to 0.09 more


@pytest.mark.parametrize("factor", [0.7, 1.5, 2.0])
@pytest.mark.parametrize("tip_mm", [0.5, 1.03, 1.07, 1.11])
def test_a_scan_of_another_resolution_has_the_same_surface_below_the_tip(tip_mm, factor):
    y_mm, sd_mm, start_mm, _ = observe(tip_mm)
    other_mm, other_sd_mm, other_start_mm, _ = observe(tip_mm, factor)
    assert other_start_mm - other_mm == pytest.approx(start_mm - y_mm, abs=0.002)
    assert other_sd_mm == pytest.approx(sd_mm, abs=0.002)


@pytest.mark.parametrize("factor", [0.7, 1.0, 1.5, 2.0])
@pytest.mark.parametrize(("tip_mm", "is_known"), [(1.11, True), (1.13, False), (2.5, False)])
def test_a_surface_is_not_known_far_from_what_is_visible(tip_mm, is_known, factor):
    found = observation_of(tip_mm, factor)[0].found
    assert ({"ilm", "rpe", "target_layer"} <= set(found)) == is_known
    assert is_known or set(found) == {"needle_tip", "needle_line"}


@pytest.mark.parametrize("factor", [0.7, 1.0, 1.5, 2.0])
@pytest.mark.parametrize(("tip_mm", "is_known"), [(1.44, True), (1.47, False)])
def test_below_a_visible_ilm_the_rpe_is_known_further_from_what_is_visible(tip_mm, is_known, factor):
    found = observation_of(tip_mm, factor, ilm_end_mm=2.0)[0].found
    assert "ilm" in found
    assert ({"rpe", "target_layer"} <= set(found)) == is_known
