import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

from haptigraph.sim.eye.motion_blur import line_kernel
from haptigraph.sim.phantom import Phantom
from haptigraph.sim.robot.operator import Hand, Move
from haptigraph.sim.scenario import load_scenario


@given(st.floats(0, 30), st.floats(-360, 360))
def test_a_kernel_keeps_brightness_and_position(length_px, angle_deg):
    kernel = line_kernel(length_px, angle_deg)
    assert kernel.shape[0] == kernel.shape[1]
    assert kernel.shape[0] % 2 == 1
    assert kernel.sum() == pytest.approx(1, abs=1e-5)
    assert kernel == pytest.approx(kernel[::-1, ::-1], abs=1e-5)


@pytest.mark.parametrize("angle_deg", [0, 30, 90, 135])
def test_a_kernel_has_the_length_and_direction_of_the_motion(angle_deg):
    kernel = line_kernel(9.0, angle_deg)
    half = kernel.shape[0] // 2
    y, x = np.mgrid[-half : half + 1, -half : half + 1]
    turn = np.radians(angle_deg)
    along, across = x * np.cos(turn) + y * np.sin(turn), y * np.cos(turn) - x * np.sin(turn)
    variance = (kernel * along**2).sum()
    assert variance == pytest.approx(9.0**2 / 12, abs=0.4)  # of a uniform motion; pixels add a little
    assert (kernel * across**2).sum() < 0.4


def small(**camera):
    scenario = load_scenario("align_then_approach")
    return replace(
        scenario,
        camera=replace(
            scenario.camera,
            width_px=640,
            height_px=360,
            center_px=(320.0, 201.0),
            px_per_mm=10.0,
            read_noise_grey=0.0,
            shot_noise_grey=0.0,
            **camera,
        ),
        operator=Hand(tremor_rms_mm=0.0),
        moves=(Move(0.2, 4.0, 3.0), Move(1.0, 16.0, 3.0), Move(1.0, 16.0, 3.0)),
    )


def played(scenario):
    phantom, moments = Phantom(scenario), []
    while moment := phantom.advance():
        moments.append(moment)
    return moments


def test_an_open_shutter_blurs_the_moving_needle_alone_and_keeps_the_truth():
    sharp, blurred = played(small()), played(small(shutter_s=0.03))
    assert [moment.truth for moment in sharp] == [moment.truth for moment in blurred]
    differences = [np.abs(a.image.astype(int) - b.image).max() for a, b in zip(sharp, blurred, strict=True)]
    speeds = np.abs(np.diff([moment.truth.depth_mm for moment in sharp], prepend=sharp[0].truth.depth_mm))
    assert max(differences) > 10
    assert all(difference == 0 for difference, speed in zip(differences, speeds, strict=True) if speed == 0)


def test_the_camera_s_own_motion_blurs_everything_and_shifts_nothing():
    sharp, shaken = (played(small(**shake))[0].image for shake in ({}, {"shake_px": 6.0, "shake_deg": 20.0}))
    expected = cv2.filter2D(sharp, -1, line_kernel(6.0, 20.0))
    assert np.abs(shaken.astype(int) - expected).max() <= 1
