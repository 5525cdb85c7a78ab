"""List the kinds of sources, with their syntax, and the connected cameras, without opening any."""

import sys
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path
from typing import NamedTuple

from haptigraph.errors import HaptigraphError
from haptigraph.sources.cameras.realsense_sdk import info_of, sdk
from haptigraph.sources.naming import DEFAULT_SCENARIO

__all__ = ["SourceKind", "connected_cameras", "source_kinds"]

VIDEO4LINUX = Path("/sys/class/video4linux")


class SourceKind(NamedTuple):
    """One kind of source."""

    syntax: str
    description: str
    missing_extra: str = ""
    """The extra that it needs and that is not installed."""


def source_kinds() -> list[SourceKind]:
    """Return all kinds of sources."""
    oct = "" if find_spec("eyepy") and find_spec("pydicom") else "oct"
    dicom = "" if find_spec("pydicom") else "dicom"
    realsense = "" if find_spec("pyrealsense2") else "realsense"
    ros = "" if find_spec("cyclonedds") else "ros"
    rosbag = "" if find_spec("rosbags") else "rosbag"
    return [
        SourceKind(
            "phantom[:SCENARIO]",
            f"a simulated eye and operator; scenarios are below, or the path of your own (.toml); default: "
            f"{DEFAULT_SCENARIO}",
        ),
        SourceKind("teleop[:SCENARIO]", "a simulated eye whose needle you steer"),
        SourceKind("camera:N", "a UVC camera; or the path of its device, or the URL of a stream"),
        SourceKind("realsense[:SERIAL]", "an Intel RealSense camera, with its own time stamps", realsense),
        SourceKind(
            "ros2:TOPIC", "images of a ROS 2 topic, raw or compressed; needs no ROS installation", ros
        ),
        SourceKind(
            "rosbag:PATH[?topic=TOPIC]", "images of a ROS 2 bag, .mcap or .db3, file or folder", rosbag
        ),
        SourceKind("FILE.db3, FILE.bag", "a recording of the RealSense SDK", realsense),
        SourceKind("FILE.mcap", "a recording of haptigraph"),
        SourceKind("FILE.mp4, .mkv, .mov, .avi ...", "a video, with its own time stamps"),
        SourceKind("FILE.dcm", "a DICOM file, one image or many; the suffix may be missing", dicom),
        SourceKind("oct:PATH", "B-scans: DICOM, a vendor's file, a folder, a video of a monitor", oct),
        SourceKind("FILE.vol, .e2e, .fda, .eye", "an OCT file of a vendor or of eyepy", oct),
        SourceKind("FOLDER", "images, in order of their names, at source.rate_hz"),
    ]


def connected_cameras() -> list[tuple[str, str]]:
    """Return the URI and name of every connected camera."""
    return [*_uvc(VIDEO4LINUX), *_realsense()]


def _uvc(folder: Path) -> Iterator[tuple[str, str]]:
    """Yield the cameras that Video4Linux lists; other systems list none without opening them."""
    if not sys.platform.startswith("linux") or not folder.is_dir():
        return
    nodes = {int(node.name.removeprefix("video")): node for node in folder.glob("video[0-9]*")}
    for number in sorted(nodes):
        if _text_of(nodes[number] / "index") in ("", "0"):  # other nodes carry metadata, not images
            yield f"camera:{number}", _text_of(nodes[number] / "name") or "unnamed camera"


def _text_of(file: Path) -> str:
    try:
        return file.read_text(encoding="utf-8", errors="replace").strip()
    except OSError:
        return ""


def _realsense() -> Iterator[tuple[str, str]]:
    try:
        devices = list(sdk().context().query_devices())
    except (HaptigraphError, RuntimeError):
        return
    for device in devices:
        yield f"realsense:{info_of(device, 'serial_number')}", info_of(device, "name")
