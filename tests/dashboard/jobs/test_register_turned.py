"""A camera that is turned, on the registration page: requested as it is, delivered upright."""

import numpy as np
import pytest

from haptigraph import assemble
from haptigraph.config import SourceConfig
from haptigraph.dashboard.jobs import register
from haptigraph.messages import Capture
from haptigraph.stages import Source


class Camera(Source):
    """Delivers images of the size that was requested."""

    is_live, registration, notes, teleop = True, None, (), None

    def __init__(self, argument, *, size_px, rate_hz, clock, fourcc):
        self.size_px, self.rate_hz, self.clock = size_px, rate_hz, clock

    def read(self, timeout_s):
        width, height = self.size_px
        return Capture(0, self.clock.now_ns(), np.zeros((height, width, 3), np.uint8))

    def close(self):
        pass


@pytest.mark.parametrize("size_px", [(0, 0), (640, 480)])
@pytest.mark.parametrize("rotate_deg", [0, 90, 180, 270])
def test_a_turned_camera_delivers_its_own_size_turned(monkeypatch, size_px, rotate_deg):
    monkeypatch.setitem(assemble.SOURCES, "camera", f"{__name__}:Camera")
    monkeypatch.setattr(
        assemble,
        "_load",
        lambda path, load=assemble._load: Camera if path.endswith(":Camera") else load(path),
    )
    settings = SourceConfig("camera:0", width_px=size_px[0], height_px=size_px[1], rotate_deg=rotate_deg)
    images = register._camera_images(settings)
    width, height = size_px if size_px[0] else register.CAMERA_PX
    upright = (height, width) if rotate_deg in (0, 180) else (width, height)
    assert next(images).shape[:2] == upright
    images.close()
