"""Every source fulfils the Source contract. A new source joins the lists below."""

import itertools
import threading
from contextlib import contextmanager

import cv2
import numpy as np
import pytest
from helpers import mostly_slow
from streaming import StreamingCamera

from haptigraph import assemble
from haptigraph.analysis.metrics.replay import replay
from haptigraph.clock import MonotonicClock, VirtualClock
from haptigraph.config import load_config
from haptigraph.errors import EndOfSource, SourceLost
from haptigraph.messages import Capture
from haptigraph.recording.codec import encode_jpeg, encode_png
from haptigraph.recording.reader import RunReader
from haptigraph.sources.cameras import reconnect
from haptigraph.stages import Source

FILES = ["dicom", "images", "oct", "phantom", "realsense-file", "recording", "rosbag", "video"]
LIVE = ["camera", "realsense"]
MAX_READS = 400  # of 50 ms


def images_of(quick_uri):
    """Images of the phantom, so that every source shows an eye."""
    source = assemble.open_source(load_config(None, (f"source.uri={quick_uri}",)), VirtualClock())
    images = []
    while len(images) < 30:
        images.append(source.read(1.0).image)
    source.close()
    return images


def make_dicom(path, images, **elements):
    dicom_files = pytest.importorskip("dicom_files", reason="needs pydicom", exc_type=ImportError)
    rgb = np.array(images)[..., ::-1]
    dicom_files.write(path, dicom_files.dicom(np.ascontiguousarray(rgb), "RGB", FrameTime=40, **elements))


def make_oct(path, images):
    make_dicom(path, images, PixelSpacing=[0.0039, 0.0115])


def make_realsense(path, images):
    device = pytest.importorskip("realsense_device", reason="needs pyrealsense2", exc_type=ImportError)
    device.record(path, images, [7e6 + 33.3 * number for number in range(len(images))])


def make_rosbag(path, images):
    ros_bags = pytest.importorskip("ros_bags", reason="needs rosbags", exc_type=ImportError)
    ros_bags.images_bag(path, images)


def make_video(path, images):
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), 30.0, images[0].shape[1::-1])
    for image in images:
        writer.write(image)
    writer.release()


def make_images(path, images):
    path.mkdir()
    for number, image in enumerate(images):
        (path / f"{number}.png").write_bytes(encode_png(image))


MAKERS = {
    "dicom": (make_dicom, "run.dcm"),
    "images": (make_images, "folder"),
    "oct": (make_oct, "oct.dcm"),
    "realsense-file": (make_realsense, "run.db3"),
    "rosbag": (make_rosbag, "bag"),
    "video": (make_video, "run.avi"),
}


@pytest.fixture(scope="module")
def uri(request, tmp_path_factory, quick_uri):
    kind, folder = request.param, tmp_path_factory.mktemp("source")
    if kind == "phantom":
        return quick_uri
    if kind == "recording":
        path = folder / "r.mcap"
        settings = (f"source.uri={quick_uri}", "run.realtime=false", f'recording.path="{path}"')
        assemble.build(load_config(None, settings)).run()
        return str(path)
    make, name = MAKERS[kind]
    make(folder / name, images_of(quick_uri))
    return f"oct:{folder / name}" if kind == "oct" else str(folder / name)


@pytest.fixture(scope="module")
def eye(quick_uri, tmp_path_factory):
    """Path of a registration of the phantom's images."""
    source = assemble.open_source(load_config(None, (f"source.uri={quick_uri}",)), VirtualClock())
    file = tmp_path_factory.mktemp("eye") / "eye.toml"
    file.write_text(source.registration)
    source.close()
    return file


def open_uri(uri):
    return assemble.open_source(load_config(None, (f'source.uri="{uri}"',)), VirtualClock())


def drain(source):
    captures = []
    try:
        while len(captures) < 1000:
            capture = source.read(1.0)
            if capture is not None:
                captures.append(capture)
    except EndOfSource:
        return captures
    raise AssertionError("the source does not end")


def test_every_source_is_listed_and_inherits_the_defaults_of_optional_members():
    tested_elsewhere = {"ros2", "teleop"}  # tests/sources/cameras/test_ros2.py, tests/sources/test_steered.py
    assert {*FILES, *LIVE, *tested_elsewhere} == set(assemble.SOURCES)
    for path in assemble.SOURCES.values():
        assert Source in assemble._load(path).__mro__


def check_members(source, *, is_live, teleop=None):
    assert isinstance(source, Source)
    assert source.is_live is is_live
    assert source.rate_hz > 0
    assert isinstance(source.notes, tuple) and all(isinstance(note, str) for note in source.notes)
    assert source.registration is None or "format" in source.registration
    assert source.teleop is teleop


def test_the_steered_source_has_every_member():
    source = assemble.open_source(load_config(None, ("source.uri=teleop",)), VirtualClock())
    check_members(source, is_live=True, teleop=source._source.teleop)  # beneath the JPEG compression
    assert source.teleop is not None
    source.close()


@pytest.mark.parametrize("uri", FILES, indirect=True)
def test_a_source_delivers_ordered_captures_and_then_ends_for_good(uri):
    source = open_uri(uri)
    check_members(source, is_live=False)
    captures = drain(source)
    assert len(captures) >= 5
    indices = [capture.index for capture in captures]
    stamps = [capture.stamp_ns for capture in captures]
    assert indices == sorted(indices)
    assert stamps == sorted(stamps)
    assert stamps[0] == 0
    assert all(isinstance(capture, Capture) for capture in captures)
    assert all(capture.image.dtype == np.uint8 for capture in captures if capture.image is not None)
    with pytest.raises(EndOfSource):
        source.read(1.0)
    source.close()
    source.close()


@pytest.mark.parametrize("uri", mostly_slow(FILES, "phantom", "rosbag", "video"), indirect=True)
def test_opening_again_delivers_the_same_images(uri):
    first, second = open_uri(uri), open_uri(uri)
    for one, other in zip(drain(first), drain(second), strict=True):
        assert one.stamp_ns == other.stamp_ns
        assert one.camera == other.camera
        assert (one.image is None) == (other.image is None)
        assert one.image is None or np.array_equal(one.image, other.image)
    first.close()
    second.close()


@pytest.mark.parametrize("uri", FILES, indirect=True)
def test_a_file_can_be_closed_before_its_end(uri):
    source = open_uri(uri)
    source.read(1.0)
    source.close()
    source.close()


@pytest.mark.parametrize("uri", mostly_slow(FILES, "phantom", "realsense-file", "video"), indirect=True)
def test_a_recorded_run_replays_identically_with_the_cameras_stamps(uri, eye, tmp_path):
    run = tmp_path / "run.mcap"
    settings = (
        f'source.uri="{uri}"',
        f'source.registration="{eye}"',
        f'recording.path="{run}"',
        "run.realtime=false",
    )
    assemble.build(load_config(None, settings)).run()
    stamps = [capture.camera for capture in drain(open_uri(uri))]
    recorded = [capture.camera for capture, _ in RunReader(run).records(images=())]
    assert recorded[: len(stamps)] == stamps
    report = replay(run)
    assert report.identical == report.steps > 20


# --- live


@contextmanager
def camera_on_the_network(images):
    camera = StreamingCamera([encode_jpeg(image, 90) for image in images])
    try:
        yield camera.uri, camera.unplug, camera.plug_in
    finally:
        if not camera.gone.is_set():
            camera.unplug()


@contextmanager
def realsense_camera(images, monkeypatch):
    device = pytest.importorskip("realsense_device", reason="needs pyrealsense2", exc_type=ImportError)
    height, width = images[0].shape[:2]
    camera, ended, silent = device.SoftwareCamera((width, height)), threading.Event(), threading.Event()

    def feed():
        for number in itertools.count():
            if ended.wait(0.02):
                return
            if not silent.is_set():
                camera.push(number, 5000 + 20.0 * number, images[number % len(images)])

    monkeypatch.setattr("haptigraph.sources.cameras.realsense.find_device", lambda serial: camera.device)
    monkeypatch.setattr("haptigraph.sources.cameras.realsense.IMAGE_TIMEOUT_MS", 100)
    thread = threading.Thread(target=feed)
    thread.start()
    try:
        yield "realsense", silent.set, silent.clear
    finally:
        ended.set()
        thread.join()


@pytest.fixture
def plugged(request, quick_uri, monkeypatch):
    """A running camera: its name, how to unplug it, and how to plug it in again."""
    monkeypatch.setattr(reconnect, "RETRY_S", (0.02,))
    images = images_of(quick_uri)
    if request.param == "camera":
        opened = camera_on_the_network(images)
    else:
        opened = realsense_camera(images, monkeypatch)
    with opened as (uri, unplug, plug_in):
        yield uri, unplug, plug_in, images[0].shape[1::-1]


def read_until(source, wanted):
    for _ in range(MAX_READS):
        try:
            result = source.read(0.05)
        except SourceLost as lost:
            result = lost
        if wanted(result):
            return result
    raise AssertionError("no result matched")


@pytest.mark.parametrize("plugged", LIVE, indirect=True)
def test_a_live_source_delivers_its_newest_image_and_reconnects(plugged):
    uri, unplug, plug_in, size_px = plugged
    clock = MonotonicClock()
    config = load_config(None, (f'source.uri="{uri}"', "source.jpeg_quality=0"))
    source = assemble.open_source(config, clock, size_px)
    check_members(source, is_live=True)
    assert source.notes and all(uri in note for note in source.notes)
    captures = [read_until(source, lambda result: isinstance(result, Capture)) for _ in range(5)]
    for before, after in itertools.pairwise(captures):
        assert before.index < after.index
        assert before.stamp_ns < after.stamp_ns <= clock.now_ns()
    assert captures[0].image.shape == (size_px[1], size_px[0], 3)
    unplug()
    lost = read_until(source, lambda result: isinstance(result, SourceLost))
    assert str(lost) == f"{uri} delivers no images; trying to get it back"
    assert source.read(0.01) is None
    plug_in()
    back = read_until(source, lambda result: isinstance(result, Capture))
    assert back.index > captures[-1].index
    assert back.stamp_ns > captures[-1].stamp_ns
    source.close()
    source.close()


@pytest.mark.parametrize("plugged", LIVE, indirect=True)
def test_a_live_run_that_loses_its_camera_replays_identically(plugged, eye, tmp_path):
    uri, unplug, plug_in, _ = plugged
    run = tmp_path / "run.mcap"
    settings = (
        f'source.uri="{uri}"',
        f'source.registration="{eye}"',
        f'recording.path="{run}"',
        "source.rate_hz=30",
    )
    loop = assemble.build(load_config(None, settings))
    images, was_lost = 0, False
    for step in loop.steps():
        images += not step.faults
        if images == 10:
            unplug()
            images += 1
        if any("delivers no images" in fault.message for fault in step.faults):
            assert step.conclusion.state == "unknown"
            was_lost = True
            plug_in()
        if was_lost and not step.faults:
            break
    loop.close()
    report = replay(run)
    assert report.identical == report.steps > 10
    stamps = [capture.stamp_ns for capture, _ in RunReader(run).records(images=())]
    assert stamps == sorted(stamps)
