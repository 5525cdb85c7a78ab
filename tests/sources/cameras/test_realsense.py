"""RealSense sources with the SDK's software device, recorded and live; no camera is needed."""

import itertools
import sys
import threading

import numpy as np
import pytest
from helpers import drain

from haptigraph import assemble
from haptigraph.analysis.metrics.replay import replay
from haptigraph.clock import MonotonicClock, VirtualClock
from haptigraph.config import load_config
from haptigraph.errors import BadInput, MissingExtra, SourceLost
from haptigraph.recording.reader import RunReader
from haptigraph.sources.cameras import realsense, realsense_sdk
from haptigraph.sources.cameras import reconnect as live
from haptigraph.sources.cameras.realsense import RealsenseSource
from haptigraph.sources.cameras.realsense_file import RealsenseFile

rs = pytest.importorskip("pyrealsense2", reason="needs pyrealsense2 and libusb", exc_type=ImportError)
from realsense_device import SERIAL, SoftwareCamera, record  # noqa: E402 - needs the SDK

RNG = np.random.default_rng(5)
IMAGES = [RNG.integers(0, 256, (96, 128, 3)).astype(np.uint8) for _ in range(40)]
STAMPS_MS = [1.7e12 + 33.3333 * number + (number % 5) for number in range(40)]
PATIENCE = 400  # reads of 50 ms


@pytest.fixture(autouse=True)
def short_timeouts(monkeypatch):
    monkeypatch.setattr(live, "RETRY_S", (0.01,))
    monkeypatch.setattr(realsense, "IMAGE_TIMEOUT_MS", 50)


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    path = tmp_path_factory.mktemp("realsense") / "run.db3"
    record(path, IMAGES, STAMPS_MS)
    return path


# --- recorded and played back


def test_all_recorded_images_are_read_with_the_cameras_stamps(recorded):
    source = RealsenseFile(recorded)
    assert source.rate_hz == 30.0
    captures = drain(source, 10.0)
    assert len(captures) == len(IMAGES)
    for capture, image, stamp_ms in zip(captures, IMAGES, STAMPS_MS, strict=True):
        assert np.array_equal(capture.image, image)
        assert (capture.camera.clock, capture.camera.stamp_ns) == ("global", round(stamp_ms * 1e6))
        assert capture.stamp_ns == round(stamp_ms * 1e6) - round(STAMPS_MS[0] * 1e6)
    source.close()


def test_a_slow_reader_gets_all_images(recorded, monkeypatch):
    monkeypatch.setattr("haptigraph.sources.cameras.realsense_file.POLL_S", 0.001)
    source = RealsenseFile(recorded)
    waited = threading.Event()
    captures = []
    for _ in IMAGES:
        waited.wait(0.005)
        captures.append(source.read(10.0))
    assert np.array_equal([capture.image for capture in captures], IMAGES)
    source.close()


@pytest.mark.parametrize("read", [0, 1, 40])
def test_a_file_can_be_closed_at_any_image(recorded, read):
    source = RealsenseFile(recorded)
    for _ in range(read):
        source.read(1.0)
    source.close()
    source.close()


def test_a_file_is_not_stopped_before_its_first_image(recorded, monkeypatch):
    delivered, on_frame = [], RealsenseFile._on_frame
    monkeypatch.setattr(
        RealsenseFile, "_on_frame", lambda self, frame: delivered.append(frame) or on_frame(self, frame)
    )
    RealsenseFile(recorded).close()
    assert delivered


def test_rgb_is_converted_to_bgr(tmp_path):
    record(tmp_path / "rgb.db3", IMAGES[:2], STAMPS_MS[:2], fmt=rs.format.rgb8)
    first, _ = drain(RealsenseFile(tmp_path / "rgb.db3"), 10.0)
    assert np.array_equal(first.image, IMAGES[0][..., ::-1])


def test_yuv_is_converted_to_bgr():
    class Frame:  # the software device streams no YUV to Python; its layout is the SDK's
        def get_data(self):
            return np.full((2, 4), 0x80B4, np.uint16)  # Y 180, U and V 128

        def get_profile(self):
            return self

        def format(self):
            return rs.format.yuyv

    image = realsense_sdk.image_of(Frame())
    assert image.shape == (2, 4, 3)
    assert np.ptp(image) <= 1
    assert abs(int(image[0, 0, 0]) - round((180 - 16) * 255 / 219)) <= 1


@pytest.mark.parametrize("uri", ["{}", "realsense:{}"])
def test_a_file_is_opened_by_its_path(recorded, uri):
    config = load_config(None, (f'source.uri="{uri.format(recorded)}"',))
    assert not assemble.is_realtime(config)
    source = assemble.open_source(config, VirtualClock())
    assert np.array_equal(source.read(1.0).image, IMAGES[0])
    source.close()


def test_a_bad_file_is_rejected_in_one_sentence(recorded, tmp_path):
    (tmp_path / "text.db3").write_text("hello" * 100)
    (tmp_path / "torn.db3").write_bytes(recorded.read_bytes()[:40_000])
    (tmp_path / "old.bag").write_text("hello" * 100)
    for name in ("text.db3", "torn.db3", "old.bag"):
        with pytest.raises(BadInput) as raised:
            RealsenseFile(tmp_path / name)
        assert str(raised.value).startswith(
            f"{tmp_path / name}: not a file that the RealSense SDK can read ("
        )
        assert "\n" not in str(raised.value)
    with pytest.raises(BadInput, match=r"gone\.db3: no such file"):
        RealsenseFile(tmp_path / "gone.db3")


def test_a_file_without_colour_is_rejected(tmp_path):
    record(tmp_path / "ir.db3", IMAGES[:2], STAMPS_MS[:2], colour=False)
    with pytest.raises(BadInput, match=r"ir\.db3 has no colour images"):
        RealsenseFile(tmp_path / "ir.db3")


def test_a_recording_of_the_sdk_runs_through_the_pipeline_and_keeps_its_stamps(
    tmp_path, quick_uri, registration_of_quick
):
    phantom = assemble.open_source(load_config(None, (f"source.uri={quick_uri}",)), VirtualClock())
    images = [capture.image for capture in itertools.islice(drain(phantom, 10.0), 60)]
    stamps_ms = [5e6 + 1000 / 15 * number + (number % 3) for number in range(len(images))]
    record(tmp_path / "eye.db3", images, stamps_ms, rate_hz=15)
    run = tmp_path / "run.mcap"
    settings = (
        f'source.uri="{tmp_path / "eye.db3"}"',
        f'source.registration="{registration_of_quick}"',
        f'recording.path="{run}"',
    )
    loop = assemble.build(load_config(None, settings))
    tips = sum("needle_tip" in step.observation.found for step in loop.steps())
    assert tips > 30
    captures = [capture for capture, _ in RunReader(run).records()]
    assert [capture.camera.stamp_ns for capture in captures[:-1]] == [round(ms * 1e6) for ms in stamps_ms]
    assert {capture.camera.clock for capture in captures[:-1]} == {"global"}
    intervals_ns = np.diff([capture.stamp_ns for capture in captures[:-1]])
    assert np.array_equal(intervals_ns, np.diff([round(ms * 1e6) for ms in stamps_ms]))
    assert all(np.array_equal(one.image, other) for one, other in zip(captures, images, strict=False))
    report = replay(run)
    assert report.identical == report.steps == len(images) + 1


@pytest.fixture
def registration_of_quick(quick_uri, tmp_path):
    source = assemble.open_source(load_config(None, (f"source.uri={quick_uri}",)), VirtualClock())
    file = tmp_path / "eye.toml"
    file.write_text(source.registration)
    source.close()
    return file


# --- live


class Feeding:
    """A camera that streams on its own until silenced."""

    def __init__(self, domain):
        self.camera, self.domain = SoftwareCamera(), domain
        self.silent, self.over = threading.Event(), threading.Event()
        self.thread = threading.Thread(target=self.feed)
        self.thread.start()

    def feed(self):
        for number in itertools.count():
            if self.over.wait(0.01):
                return
            if not self.silent.is_set():
                self.camera.push(number, 5000 + 10.0 * number, IMAGES[number % 40], self.domain)

    def find(self, serial):
        return self.camera.device


@pytest.fixture(params=["hardware_clock", "global_time"])
def feeding(request):
    camera = Feeding(getattr(rs.timestamp_domain, request.param))
    yield camera
    camera.over.set()
    camera.thread.join()


def open_camera(feeding, **options):
    requested = {
        "size_px": (128, 96),
        "rate_hz": 30.0,
        "clock": MonotonicClock(),
        "find": feeding.find,
        **options,
    }
    return RealsenseSource("", **requested)


def read_until(source, wanted):
    for _ in range(PATIENCE):
        try:
            result = source.read(0.05)
        except SourceLost as lost:
            result = lost
        if wanted(result):
            return result
    raise AssertionError("no result matched")


def is_image(result):
    return result is not None and not isinstance(result, SourceLost)


def test_live_images_have_the_cameras_stamp_and_one_on_the_runs_clock(feeding):
    source = open_camera(feeding)
    captures = [read_until(source, is_image) for _ in range(20)]
    source.close()
    clock = "hardware" if feeding.domain == rs.timestamp_domain.hardware_clock else "global"
    for before, after in itertools.pairwise(captures):
        assert before.stamp_ns < after.stamp_ns <= after.camera.arrived_ns
        assert before.camera.stamp_ns < after.camera.stamp_ns
    assert {capture.camera.clock for capture in captures} == {clock}
    offsets_ns = [capture.camera.arrived_ns - capture.camera.stamp_ns for capture in captures]
    assert captures[-1].stamp_ns - captures[-1].camera.stamp_ns <= min(offsets_ns)
    number = (captures[-1].camera.stamp_ns - 5_000_000_000) // 10_000_000
    assert np.array_equal(captures[-1].image, IMAGES[number % 40])
    assert source.notes == (
        f"realsense is Intel RealSense D405, serial number {SERIAL}; it delivers 128 x 96 px, 30 images/s, as requested, "
        f"stamped by its {clock} clock",
    )


def test_a_silent_camera_is_reported_once_and_reconnects(feeding):
    source = open_camera(feeding)
    before = read_until(source, is_image)
    feeding.silent.set()
    lost = read_until(source, lambda result: isinstance(result, SourceLost))
    assert str(lost) == "realsense delivers no images; trying to get it back"
    assert source.read(0.05) is None
    feeding.silent.clear()
    back = read_until(source, is_image)
    assert back.index > before.index
    assert back.stamp_ns > before.stamp_ns
    source.close()


def test_after_a_loss_the_same_camera_is_reopened(feeding):
    serials = []

    def find(serial):
        serials.append(serial)
        if len(serials) == 2:
            raise RuntimeError("the bus is being reset")
        return feeding.camera.device

    source = open_camera(feeding, find=find)
    feeding.silent.set()
    read_until(source, lambda result: isinstance(result, SourceLost))
    feeding.silent.clear()
    read_until(source, is_image)
    source.close()
    assert serials[:3] == ["", SERIAL, SERIAL]


def test_an_unsupported_video_mode_is_rejected_with_the_supported_ones(feeding):
    problem = r"realsense has no colour images of 640 x 480 px at 15/s; supported are 128 x 96 at 30"
    with pytest.raises(BadInput, match=problem):
        open_camera(feeding, size_px=(640, 480), rate_hz=15.0)


def test_a_camera_without_images_is_rejected(feeding, monkeypatch):
    monkeypatch.setattr(realsense, "FIRST_IMAGE_TIMEOUT_MS", 50)
    feeding.silent.set()
    with pytest.raises(BadInput, match="realsense opens but delivers no image"):
        open_camera(feeding)


# --- connected cameras


class Bus:
    """The part of the SDK that lists connected cameras."""

    camera_info = rs.camera_info

    def __init__(self, *serials):
        self.cameras = [SoftwareCamera(serial=serial) for serial in serials]

    def context(self):
        return self

    def query_devices(self):
        return [camera.device for camera in self.cameras]


@pytest.mark.parametrize(
    ("connected", "serial", "problem"),
    [
        ((), "", "no RealSense camera is connected; connect one"),
        ((), "7", "no RealSense camera 7; no RealSense camera is connected"),
        (("1", "2"), "7", "no RealSense camera 7; connected: 1, 2"),
        (("1", "2"), "", "several RealSense cameras are connected: 1, 2; choose one with realsense:SERIAL"),
    ],
)
def test_a_camera_that_is_not_found_is_reported_in_one_sentence(monkeypatch, connected, serial, problem):
    bus = Bus(*connected)
    monkeypatch.setattr(realsense_sdk, "sdk", lambda: bus)
    with pytest.raises(BadInput) as raised:
        realsense_sdk.find_device(serial)
    assert str(raised.value) == problem


def test_the_only_camera_needs_no_serial_number_and_one_of_several_does(monkeypatch):
    bus = Bus("1")
    monkeypatch.setattr(realsense_sdk, "sdk", lambda: bus)
    assert realsense_sdk.find_device("") is bus.cameras[0].device
    bus = Bus("1", "2")
    assert realsense_sdk.info_of(realsense_sdk.find_device("2"), "serial_number") == "2"


def test_a_camera_that_is_not_connected_is_reported_by_the_real_sdk():
    with pytest.raises(BadInput, match="no RealSense camera 0815"):
        realsense_sdk.find_device("0815")


def test_a_missing_extra_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "pyrealsense2", None)
    with pytest.raises(MissingExtra, match=r"pip install 'haptigraph\[realsense\]'"):
        realsense_sdk.sdk()


def test_a_missing_libusb_is_reported_with_debians_package(monkeypatch):
    def broken(name):
        raise ImportError("libusb-1.0.so.0: cannot open shared object file")

    monkeypatch.setattr(realsense_sdk, "import_module", broken)
    with pytest.raises(BadInput, match=r"pyrealsense2 cannot be loaded .* apt-get install libusb-1\.0-0"):
        realsense_sdk.sdk()
