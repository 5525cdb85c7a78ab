import threading

import cv2
import numpy as np
import pytest
from streaming import StreamingCamera

from haptigraph.clock import MonotonicClock, VirtualClock
from haptigraph.errors import BadInput, SourceLost
from haptigraph.recording.codec import encode_jpeg
from haptigraph.sources.cameras import reconnect as live
from haptigraph.sources.cameras.uvc import CameraSource, UvcCamera

MS = 1_000_000


class FakeCamera:
    """A driver whose images a test releases one by one, and that decodes slowly."""

    def __init__(self, size_px=(1280, 720), rate_hz=30.0, clock=None, stamps_ms=()):
        self.opened, self.released = 0, 0
        self.is_there = True
        self.next = threading.Semaphore(0)
        self.settings: dict[int, float] = {}
        self.size_px, self.rate_hz, self.clock = size_px, rate_hz, clock
        self.stamps_ms, self.backend = list(stamps_ms), "V4L2"
        self.stamp_ms = 0.0

    def __call__(self, device):
        self.opened += 1
        self.device = device
        return self

    def isOpened(self):
        return self.is_there

    def getBackendName(self):
        return self.backend

    def set(self, propId, value):
        self.settings[propId] = value
        return True

    def get(self, propId):
        if propId == cv2.CAP_PROP_FPS:
            return self.rate_hz
        if propId == cv2.CAP_PROP_POS_MSEC:
            return self.stamp_ms
        return self.settings.get(propId, 0.0)

    def grab(self):
        if self.clock is None and self.opened and self.settings:
            self.next.acquire(timeout=0.05)
        if self.stamps_ms:
            self.stamp_ms = self.stamps_ms.pop(0)
        return self.is_there

    def retrieve(self):
        if self.clock is not None:
            self.clock.wait_until(self.clock.now_ns() + 25 * MS)  # decoding
        return True, np.zeros((self.size_px[1], self.size_px[0], 3), np.uint8)

    def release(self):
        self.released += 1


@pytest.fixture(autouse=True)
def fast_retries(monkeypatch):
    monkeypatch.setattr(live, "RETRY_S", (0.01,))


def open_camera(fake, which="0", **options):
    return CameraSource(
        which, size_px=(1280, 720), rate_hz=30.0, clock=MonotonicClock(), open_camera=fake, **options
    )


def read_until(source, wanted):
    """Read until a capture or loss matches; the camera's thread is asynchronous."""
    for _ in range(1000):
        try:
            result = source.read(0.05)
        except SourceLost as lost:
            result = lost
        if wanted(result):
            return result
    raise AssertionError("no result matched")


def test_the_newest_image_is_returned_once_stamped_on_the_runs_clock():
    fake = FakeCamera()
    source = open_camera(fake)
    first = read_until(source, lambda result: result is not None)
    second = read_until(source, lambda result: result is not None)
    assert second.index > first.index
    assert first.stamp_ns < second.stamp_ns <= MonotonicClock().now_ns()
    assert second.image.shape == (720, 1280, 3)
    source.close()
    assert fake.released == 1


def test_a_lost_camera_is_reported_once_and_reconnects():
    fake = FakeCamera()
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


def test_a_camera_whose_driver_raises_is_lost_and_reconnects():
    fake = FakeCamera()
    source = open_camera(fake)
    fake.retrieve, retrieve = lambda: {}["no such buffer"], fake.retrieve
    lost = read_until(source, lambda result: isinstance(result, SourceLost))
    assert "delivers no images ('no such buffer'); trying" in str(lost)
    fake.retrieve = retrieve
    read_until(source, lambda result: result is not None and not isinstance(result, SourceLost))
    source.close()


def uvc(fake, clock, fourcc=""):
    return UvcCamera("camera:0", fake(0), (1280, 720), 30.0, fourcc, clock)


def test_an_image_is_stamped_when_it_is_grabbed_not_when_it_is_decoded():
    clock = VirtualClock(1000 * MS)
    camera = uvc(FakeCamera(clock=clock), clock)  # decodes its first image, for 25 ms
    assert camera.take().stamp_ns == 1025 * MS
    assert clock.now_ns() == 1050 * MS


def test_the_drivers_stamp_is_used():
    clock = VirtualClock(1000 * MS)
    fake = FakeCamera(clock=clock, stamps_ms=(980.0, 1011.25, 1044.0))
    camera = uvc(fake, clock)
    image = camera.take()
    assert image.stamp_ns == image.camera.stamp_ns == 1011_250_000
    assert (image.camera.clock, image.camera.arrived_ns) == ("driver", 1025 * MS)


@pytest.mark.parametrize(
    ("backend", "stamp_ms"), [("MSMF", 1020.0), ("V4L2", 0.0), ("V4L2", 1.7e12), ("V4L2", 1026.0)]
)
def test_a_stamp_that_is_not_from_this_machines_clock_is_ignored(backend, stamp_ms):
    clock = VirtualClock(1000 * MS)
    fake = FakeCamera(clock=clock, stamps_ms=(stamp_ms, stamp_ms))
    fake.backend = backend
    image = uvc(fake, clock).take()
    assert (image.stamp_ns, image.camera) == (1025 * MS, None)


def test_a_note_compares_the_requested_and_the_actual_video_mode():
    clock = VirtualClock()
    as_requested = uvc(FakeCamera(clock=clock), clock, "MJPG")
    assert as_requested.notes == ("camera:0 delivers 1280 x 720 px, 30 images/s, MJPG, as requested",)
    other = FakeCamera((640, 480), 15.0, clock)
    camera = uvc(other, clock)
    assert camera.notes == (
        "camera:0 delivers 640 x 480 px, 15 images/s instead of 1280 x 720 px, 30 images/s",
    )
    assert camera.rate_hz == 15.0
    assert cv2.CAP_PROP_FOURCC not in other.settings
    assert uvc(FakeCamera(rate_hz=0.0, clock=clock), clock).rate_hz == 30.0


def test_a_camera_can_be_opened_by_its_device_path():
    fake = FakeCamera()
    open_camera(fake, "/dev/v4l/by-id/usb-microscope-video-index0").close()
    assert fake.device == "/dev/v4l/by-id/usb-microscope-video-index0"
    open_camera(fake, "3").close()
    assert fake.device == 3


def test_a_missing_camera_is_reported(capfd):
    with pytest.raises(BadInput, match="camera:7 cannot be opened; "):
        open_camera(lambda device: cv2.VideoCapture(device), "7")
    fake = FakeCamera()
    fake.grab = lambda: False
    with pytest.raises(
        BadInput, match="camera:0 opens but delivers no image; close other programs that use it"
    ):
        open_camera(fake)
    assert fake.released == 1


def test_opencv_logs_nothing(capfd):
    with pytest.raises(BadInput, match="camera:7 cannot be opened; "):
        CameraSource("7", size_px=(1280, 720), rate_hz=30.0, clock=MonotonicClock())
    assert capfd.readouterr().err == ""


def test_a_network_camera_is_read_lost_and_reconnected_through_opencv():
    images = [encode_jpeg(np.full((48, 64, 3), level, np.uint8), 95) for level in (20, 120, 220)]
    camera = StreamingCamera(images)
    uri = camera.uri
    source = CameraSource(uri.removeprefix("camera:"), size_px=(64, 48), rate_hz=30.0, clock=MonotonicClock())
    assert source.notes == (f"{uri} delivers 64 x 48 px; the format of a stream cannot be chosen",)
    captures = [read_until(source, lambda result: result is not None) for _ in range(4)]
    stamps = [capture.stamp_ns for capture in captures]
    assert stamps == sorted(set(stamps))
    assert stamps[-1] <= MonotonicClock().now_ns()
    assert {round(float(capture.image.mean()), -1) for capture in captures} <= {20, 120, 220}
    camera.unplug()
    lost = read_until(source, lambda result: isinstance(result, SourceLost))
    assert str(lost) == f"{uri} delivers no images; trying to get it back"
    camera.plug_in()
    back = read_until(source, lambda result: result is not None and not isinstance(result, SourceLost))
    assert back.index > captures[-1].index
    source.close()
    camera.unplug()
    with pytest.raises(
        BadInput, match=r"stream\.mjpg cannot be opened; check that a server answers at this URL"
    ):
        CameraSource(uri.removeprefix("camera:"), size_px=(64, 48), rate_hz=30.0, clock=MonotonicClock())
