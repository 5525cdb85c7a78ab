"""Which sources there are: kinds, what to type for each, and the cameras that are plugged in now.

Knows how systems list cameras; opens none of them.
"""

import sys
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path
from typing import NamedTuple

from haptigraph.errors import HaptigraphError
from haptigraph.sources.cameras.realsense_sdk import info_of, sdk

__all__ = ["Kind", "kinds", "present_cameras"]

VIDEO4LINUX = Path("/sys/class/video4linux")


class Kind(NamedTuple):
    """One way to write a source."""

    spelled: str
    says: str
    lacks: str = ""
    """The extra that it needs and that is not installed."""


def kinds() -> list[Kind]:
    """Return all kinds of sources."""
    oct = "" if find_spec("eyepy") and find_spec("pydicom") else "oct"
    dicom = "" if find_spec("pydicom") else "dicom"
    realsense = "" if find_spec("pyrealsense2") else "realsense"
    ros = "" if find_spec("cyclonedds") else "ros"
    return [
        Kind("phantom:SCENARIO", "a simulated eye and operator; or the path of a scenario (.toml)"),
        Kind("teleop:SCENARIO", "a simulated eye whose needle a hand steers"),
        Kind("camera:N", "a UVC camera; or the path of its device, or the address of a stream (http, rtsp)"),
        Kind("realsense[:SERIAL]", "an Intel RealSense camera, stamped by itself", realsense),
        Kind("ros2:TOPIC", "images of a ROS 2 topic, raw or compressed, without a ROS installation", ros),
        Kind("FILE.db3, FILE.bag", "what the RealSense SDK recorded", realsense),
        Kind("FILE.mcap", "a recording of haptigraph"),
        Kind("FILE.mp4, .mkv, .mov, .avi ...", "a video, by its own time"),
        Kind("FILE.dcm", "a DICOM file, one image or many; the suffix may be missing", dicom),
        Kind("oct:PATH", "B-scans: DICOM, a maker's file, a folder, a monitor's video", oct),
        Kind("FILE.vol, .e2e, .fda, .eye", "an OCT as its maker or eyepy stores it", oct),
        Kind("FOLDER", "images, in the order of their names, source.rate_hz of them per second"),
    ]


def present_cameras() -> list[tuple[str, str]]:
    """Return the cameras that are plugged in: what to type, and what each is."""
    return [*_uvc(VIDEO4LINUX), *_realsense()]


def _uvc(folder: Path) -> Iterator[tuple[str, str]]:
    """Yield what Video4Linux knows; other systems do not tell without opening cameras."""
    if not sys.platform.startswith("linux") or not folder.is_dir():
        return
    nodes = {int(node.name.removeprefix("video")): node for node in folder.glob("video[0-9]*")}
    for number in sorted(nodes):
        if _said(nodes[number] / "index") in ("", "0"):  # the others carry metadata, not images
            yield f"camera:{number}", _said(nodes[number] / "name") or "a camera without name"


def _said(file: Path) -> str:
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
