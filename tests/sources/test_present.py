import pytest

from haptigraph.assemble import SOURCES
from haptigraph.sources import present
from haptigraph.sources.cameras import realsense_sdk
from haptigraph.sources.present import kinds, present_cameras


@pytest.fixture
def video4linux(tmp_path, monkeypatch):
    """The kernel's list of cameras, as a folder."""
    monkeypatch.setattr(present, "VIDEO4LINUX", tmp_path)
    monkeypatch.setattr(present.sys, "platform", "linux")
    return tmp_path


def plug_in(folder, number, index, name):
    node = folder / f"video{number}"
    node.mkdir()
    (node / "index").write_text(f"{index}\n")
    (node / "name").write_text(f"{name}\n")


def test_cameras_are_listed_by_number_without_their_nodes_for_metadata(video4linux):
    for number, index, name in ((10, 0, "Microscope"), (0, 0, "Webcam: Webcam"), (1, 1, "Webcam: Webcam")):
        plug_in(video4linux, number, index, name)
    assert present_cameras() == [("camera:0", "Webcam: Webcam"), ("camera:10", "Microscope")]


def test_a_realsense_camera_is_listed_by_its_serial_number(video4linux, monkeypatch):
    device = pytest.importorskip("realsense_device", reason="needs pyrealsense2", exc_type=ImportError)
    camera = device.SoftwareCamera(serial="77")

    class Bus:
        camera_info = device.rs.camera_info

        def context(self):
            return self

        def query_devices(self):
            return [camera.device]

    for module in (present, realsense_sdk):
        monkeypatch.setattr(module, "sdk", Bus)
    assert present_cameras() == [("realsense:77", "Intel RealSense D405")]


def test_without_cameras_and_without_the_sdk_the_list_is_empty(video4linux, monkeypatch):
    monkeypatch.setitem(present.sys.modules, "pyrealsense2", None)
    assert present_cameras() == []
    monkeypatch.setattr(present, "VIDEO4LINUX", video4linux / "gone")
    assert present_cameras() == []


def test_every_kind_of_source_is_listed():
    told = " ".join(f"{kind.spelled} {kind.says}" for kind in kinds()).lower()
    words = {"images": "folder", "realsense-file": ".db3"}
    for kind in SOURCES:
        assert words.get(kind, kind) in told
