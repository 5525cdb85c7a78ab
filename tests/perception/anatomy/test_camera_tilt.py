"""The camera tilt found against the simulator's ground truth."""

import math

import pytest
from msgspec.structs import replace

from haptigraph.perception.anatomy.camera_tilt import find_camera_tilt
from haptigraph.perception.anatomy.rim import find_rim
from haptigraph.sim.phantom import Phantom
from haptigraph.sim.scenario import load_scenario


def found_tilt(quick: str, tilt_deg: tuple[float, float], distance_mm: float, is_calibrated: bool = False):
    scenario = load_scenario(quick)
    camera = replace(
        scenario.camera, tilt_deg=tilt_deg, distance_mm=distance_mm, width_px=960, height_px=540,
        center_px=(480.0, 296.0), px_per_mm=16.0,
    )  # fmt: skip
    phantom = Phantom(replace(scenario, camera=camera))
    moment = phantom.advance()
    assert moment is not None
    focal_px = 16.0 * distance_mm if is_calibrated else None
    rim, geometry = find_rim(moment.image), phantom.camera.geometry
    return find_camera_tilt(rim, (479.5, 269.5), focal_px=focal_px), geometry


@pytest.mark.parametrize(
    ("tilt_deg", "distance_mm"),
    [
        ((-4.0, 9.0), 150.0),
        *(
            pytest.param(tilt_deg, distance_mm, marks=pytest.mark.slow)
            for tilt_deg, distance_mm in (((6.0, 0.0), 60.0), ((0.0, -15.0), 300.0), ((10.0, 10.0), 2000.0))
        ),
    ],
)
def test_tilt_and_centre_are_found(quick, tilt_deg, distance_mm):
    tilt, truth = found_tilt(quick, tilt_deg, distance_mm)
    assert [math.degrees(part) for part in tilt.tilt_rad] == pytest.approx(tilt_deg, abs=0.4)
    assert math.dist(tilt.about_px, truth.to_px((0.0, 0.0))) < 0.8
    # The section is mapped correctly whatever distance was found.
    for angle in range(0, 360, 15):
        point = 12 * math.cos(math.radians(angle)), 12 * math.sin(math.radians(angle))
        frontal = tilt.frontal_from_image(truth.to_px(point))
        assert math.dist(frontal, tilt.about_px) == pytest.approx(12 * 16.0, abs=1.0)


def test_a_frontal_view_has_no_tilt(quick):
    tilt, _ = found_tilt(quick, (0.0, 0.0), 60.0)
    assert tilt is None


def test_a_calibrated_lens_makes_a_smaller_tilt_measurable(quick):
    tilt_deg = (1.2, 0.6)
    assert found_tilt(quick, tilt_deg, 45.0)[0] is None
    tilt, truth = found_tilt(quick, tilt_deg, 45.0, is_calibrated=True)
    assert [math.degrees(part) for part in tilt.tilt_rad] == pytest.approx(tilt_deg, abs=0.4)
    assert math.dist(tilt.about_px, truth.to_px((0.0, 0.0))) < 0.5


def test_a_frontal_view_has_no_tilt_before_a_calibrated_lens_either(quick):
    assert found_tilt(quick, (0.0, 0.0), 60.0, is_calibrated=True)[0] is None
