"""Depth of a RealSense camera, with the SDK's software device; no camera is needed."""

import threading

import numpy as np
import pytest

from haptigraph.clock import MonotonicClock
from haptigraph.errors import BadInput
from haptigraph.sources.cameras import realsense
from haptigraph.sources.cameras.realsense import RealsenseSource

rs = pytest.importorskip("pyrealsense2", reason="needs pyrealsense2 and libusb", exc_type=ImportError)
from realsense_device import DepthCamera  # noqa: E402 - needs the SDK

PATIENCE = 200  # reads of 50 ms


@pytest.fixture
def delivering():
    """Open a camera that delivers image after image until the test ends."""
    stop, threads, sources = threading.Event(), [], []

    def deliver(camera):
        number = 0
        while not stop.wait(0.02):
            number += 1
            image = np.full((96, 128, 3), number % 250, np.uint8)
            camera.push(number, 1e12 + 33.3 * number, image, np.full((48, 64), 800 + number % 250, np.uint16))

    def opened(camera, **options):
        threads.append(threading.Thread(target=deliver, args=(camera,)))
        threads[-1].start()
        given = {
            "size_px": (128, 96),
            "rate_hz": 30,
            "clock": MonotonicClock(),
            "find": lambda _: camera.device,
        }
        sources.append(RealsenseSource("", **given, **options))
        return sources[-1]

    yield opened
    stop.set()
    for part in threads:
        part.join()
    for source in sources:
        source.close()


def test_each_image_has_the_depths_of_its_own_pixels(delivering):
    source = delivering(DepthCamera(), depth=True)
    assert source.depth_camera.focal_px == 100.0
    assert source.depth_camera.disparity_px_mm == pytest.approx(50.0 * 18.0)
    assert "and depth" in source.notes[0]
    checked = 0
    for _ in range(PATIENCE):
        capture = source.read(0.05)
        if capture is None or capture.depth is None:
            continue
        assert capture.depth.values.shape == capture.image.shape[:2]
        assert capture.depth.unit_mm == pytest.approx(0.1)
        assert set(np.unique(capture.depth.values)) <= {0, 800 + int(capture.image[0, 0, 0])}
        assert (capture.depth.values > 0).mean() > 0.8
        checked += 1
        if checked == 5:
            return
    pytest.fail(f"only {checked} images with depth")


def test_depth_is_read_only_if_it_is_asked_for(delivering):
    source = delivering(DepthCamera())
    assert source.depth_camera is None
    assert next(capture for _ in range(PATIENCE) if (capture := source.read(0.05))).depth is None


@pytest.mark.parametrize(
    ("options", "problem"),
    [
        ({"has_depth": False}, "has no depth images at 30/s"),
        ({"baseline_mm": None}, "does not state its stereo"),
    ],
)
def test_a_camera_that_cannot_measure_depth_is_refused(options, problem, monkeypatch):
    monkeypatch.setattr(realsense, "FIRST_IMAGE_TIMEOUT_MS", 50)
    with pytest.raises(BadInput, match=problem):
        RealsenseSource(
            "",
            size_px=(128, 96),
            rate_hz=30,
            clock=MonotonicClock(),
            depth=True,
            find=lambda _: DepthCamera(**options).device,
        )
