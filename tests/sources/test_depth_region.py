"""The region around the globe is what is left of depth images, pixel by pixel where it was."""

import numpy as np
import pytest
from helpers import drain
from paths import DATA

from haptigraph.assemble import open_source
from haptigraph.clock import VirtualClock
from haptigraph.config import load_config
from haptigraph.messages import Capture, DepthImage
from haptigraph.projection import DepthCamera
from haptigraph.sources.depth_region import BEYOND_MM, with_depth_region
from haptigraph.sources.wrapper import SourceWrapper
from haptigraph.stages import Source

CAMERA = DepthCamera(500.0, (240.0, 135.0), 8000.0)


class OneImage(Source):
    """One image whose depths are the numbers of its pixels."""

    rate_hz, is_live, depth_camera = 30.0, False, CAMERA

    def __init__(self, depth):
        self._capture = Capture(0, 0, np.zeros((270, 480), np.uint8), depth=depth)

    def read(self, timeout_s):
        return self._capture

    def close(self):
        pass


@pytest.mark.parametrize("origin", [(0, 0), (100, 30)])
def test_pixels_around_the_globe_keep_their_depth(registration, origin):
    left, top = origin
    values = np.arange(270 * 480, dtype=np.uint32).astype(np.uint16).reshape(270, 480)[top:, left:]
    whole = DepthImage(values, 0.1, left, top)
    depth = with_depth_region(OneImage(whole), registration).read(1.0).depth
    rows, columns = depth.values.shape
    inside = values[depth.top_px - top :, depth.left_px - left :][:rows, :columns]
    assert (depth.values == inside).all()
    half_px = (registration.globe.radius_mm + BEYOND_MM) / registration.image.mm_per_px
    x = registration.image.to_px((0.0, 0.0))[0]
    assert depth.left_px <= max(x - half_px, left)
    assert depth.left_px + columns >= min(x + half_px, 480)
    assert depth.unit_mm == 0.1
    assert depth.values.size < values.size


def test_sources_without_depth_are_left_alone(registration):
    source = OneImage(None)
    source.depth_camera = None
    assert with_depth_region(source, registration) is source


def test_a_capture_without_depth_passes(registration):
    assert with_depth_region(OneImage(None), registration).read(1.0).depth is None


def test_wrappers_name_the_depth_camera_and_a_crop_drops_it():
    assert SourceWrapper(OneImage(None)).depth_camera == CAMERA
    uri = f"source.uri=phantom:{DATA / 'deep.toml'}"
    config = load_config(None, (uri, "source.crop_px=[0, 0, 600, 300]"))
    cropped = open_source(config, VirtualClock())
    assert cropped.depth_camera is None
    assert all(capture.depth is None for capture in drain(cropped))


def test_depth_of_the_phantom_reaches_the_reader():
    source = open_source(load_config(None, (f"source.uri=phantom:{DATA / 'deep.toml'}",)), VirtualClock())
    captures = drain(source)
    assert source.depth_camera is not None
    assert all(capture.depth is not None for capture in captures)
