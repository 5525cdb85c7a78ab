"""Watching a camera: what of it becomes the clip."""

import numpy as np
import pytest
from rig_setups import simulated_setup

from haptigraph.analysis.rig_check import clip as module
from haptigraph.analysis.rig_check.clip import SPREAD_IMAGES, watch
from haptigraph.clock import VirtualClock
from haptigraph.config import Config, SourceConfig
from haptigraph.errors import BadInput, SourceLost
from haptigraph.messages import Capture
from haptigraph.stages import Source

INTERVAL_NS = 33_333_333


class FakeCamera(Source):
    """A camera whose images come evenly, and which is lost once."""

    is_live, rate_hz = True, 30.0

    def __init__(self, clock, image, lost_at=None):
        self._clock, self._image, self._lost_at = clock, image, lost_at
        self._index = -1
        self.is_closed = False

    def read(self, timeout_s):
        self._clock.wait_until(self._clock.now_ns() + INTERVAL_NS)
        self._index += 1
        if self._index == self._lost_at:
            raise SourceLost("camera:0 is gone")
        return Capture(self._index, self._clock.now_ns(), self._image)

    def close(self):
        self.is_closed = True


@pytest.fixture(scope="module")
def setup():
    return simulated_setup(1, 9104, has_mark=False, has_reference=False)


def watched(monkeypatch, setup, image=None, lost_at=None, uri="camera:0"):
    clock = VirtualClock()
    camera = FakeCamera(clock, setup.images[0] if image is None else image, lost_at)
    monkeypatch.setattr(module, "MonotonicClock", lambda: clock)
    monkeypatch.setattr(module, "open_source", lambda *_: camera)
    try:
        return watch(Config(SourceConfig(uri=uri)), setup.registration, 2.0)[0]
    finally:
        assert camera.is_closed


@pytest.mark.parametrize("uri", ["camera:0", "own_parts:LiveSource"])
def test_a_camera_warms_up_before_it_is_watched(monkeypatch, setup, uri):
    clip = watched(monkeypatch, setup, uri=uri)
    assert clip.indices[0] == 30
    assert clip.stamps_ns[-1] - clip.stamps_ns[0] == pytest.approx(2e9, abs=INTERVAL_NS)
    assert len(clip.spread) == SPREAD_IMAGES
    assert clip.is_timed
    assert clip.losses == ()


def test_a_lost_camera_is_reported(monkeypatch, setup):
    assert watched(monkeypatch, setup, lost_at=50).losses == ("camera:0 is gone",)


def test_images_of_another_size_are_refused(monkeypatch, setup):
    with pytest.raises(BadInput, match="px"):
        watched(monkeypatch, setup, image=np.zeros((100, 100, 3), np.uint8))
