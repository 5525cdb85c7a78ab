import pytest

from haptigraph.assemble import SOURCES
from haptigraph.sources import available
from haptigraph.sources.available import connected_cameras, source_kinds
from haptigraph.sources.cameras import realsense_sdk


@pytest.fixture
def video4linux(tmp_path, monkeypatch):
    """The folder in which the kernel lists cameras."""
    monkeypatch.setattr(available, "VIDEO4LINUX", tmp_path)
    monkeypatch.setattr(available.sys, "platform", "linux")
    return tmp_path


def add_camera(folder, number, index, name):
    node = folder / f"video{number}"
    node.mkdir()
    (node / "index").write_text(f"{index}\n")
    (node / "name").write_text(f"{name}\n")


def test_cameras_are_listed_by_number_without_metadata_nodes(video4linux):
    for number, index, name in ((10, 0, "Microscope"), (0, 0, "Webcam: Webcam"), (1, 1, "Webcam: Webcam")):
        add_camera(video4linux, number, index, name)
    assert connected_cameras() == [("camera:0", "Webcam: Webcam"), ("camera:10", "Microscope")]


def test_a_realsense_camera_is_listed_by_its_serial_number(video4linux, monkeypatch):
    device = pytest.importorskip("realsense_device", reason="needs pyrealsense2", exc_type=ImportError)
    camera = device.SoftwareCamera(serial="77")

    class Bus:
        camera_info = device.rs.camera_info

        def context(self):
            return self

        def query_devices(self):
            return [camera.device]

    for module in (available, realsense_sdk):
        monkeypatch.setattr(module, "sdk", Bus)
    assert connected_cameras() == [("realsense:77", "Intel RealSense D405")]


def test_without_cameras_and_without_the_sdk_the_list_is_empty(video4linux, monkeypatch):
    monkeypatch.setitem(available.sys.modules, "pyrealsense2", None)
    assert connected_cameras() == []
    monkeypatch.setattr(available, "VIDEO4LINUX", video4linux / "missing")
    assert connected_cameras() == []


def test_every_kind_of_source_is_listed():
    text = " ".join(f"{kind.syntax} {kind.description}" for kind in source_kinds()).lower()
    words = {"images": "folder", "realsense-file": ".db3"}
    for kind in SOURCES:
        assert words.get(kind, kind) in text
