import threading

import numpy as np
import pytest

from haptigraph.clock import MonotonicClock
from haptigraph.errors import BadInput, SourceLost
from haptigraph.sources import camera as camera_module
from haptigraph.sources.camera import CameraSource

PATIENCE_S = 10.0


class FakeCamera:
    """A camera whose images a test releases one by one."""

    def __init__(self):
        self.opened, self.released = 0, 0
        self.is_there = True
        self.next = threading.Semaphore(0)
        self.settings: dict[int, float] = {}

    def __call__(self, number):
        self.opened += 1
        return self

    def isOpened(self):
        return self.is_there

    def set(self, propId, value):
        self.settings[propId] = value
        return True

    def get(self, propId):
        return self.settings.get(propId, 0.0)

    def read(self):
        self.next.acquire(timeout=0.05)
        if not self.is_there:
            return False, None
        return True, np.zeros((720, 1280, 3), np.uint8)

    def release(self):
        self.released += 1


@pytest.fixture
def fake(monkeypatch):
    monkeypatch.setattr(camera_module, "RETRY_S", (0.01,))
    return FakeCamera()


def open_camera(fake, **options):
    return CameraSource(
        0, size_px=(1280, 720), rate_hz=30.0, clock=MonotonicClock(), open_camera=fake, **options
    )


def read_until(source, wanted):
    """Read until a capture or loss that fits; a camera's thread takes its time."""
    for _ in range(1000):
        try:
            result = source.read(0.05)
        except SourceLost as lost:
            result = lost
        if wanted(result):
            return result
    raise AssertionError("it never came")


def test_the_newest_image_comes_once_stamped_on_the_runs_clock(fake):
    source = open_camera(fake)
    first = read_until(source, lambda result: result is not None)
    second = read_until(source, lambda result: result is not None)
    assert second.index > first.index
    assert first.stamp_ns < second.stamp_ns <= MonotonicClock().now_ns()
    assert second.image.shape == (720, 1280, 3)
    source.close()
    assert fake.released == 1


def test_a_camera_that_goes_away_is_told_once_and_comes_back(fake):
    source = open_camera(fake)
    read_until(source, lambda result: result is not None)
    fake.is_there = False
    lost = read_until(source, lambda result: isinstance(result, SourceLost))
    assert str(lost) == "camera:0 delivers no images; trying to get it back"
    assert source.read(0.01) is None
    fake.is_there = True
    back = read_until(source, lambda result: result is not None)
    assert back.image is not None
    assert fake.opened >= 2
    source.close()


def test_where_there_is_no_camera_it_says_so(capfd):
    with pytest.raises(BadInput, match="camera:7 cannot be opened; "):
        CameraSource(7, size_px=(1280, 720), rate_hz=30.0, clock=MonotonicClock())
    assert capfd.readouterr().err == ""
