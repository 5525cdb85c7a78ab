"""Devices, colour streams, pixels and stamps of the RealSense SDK, for live cameras and for files.

A sensor is chosen by its streams, not by its type: the D405 streams colour from its stereo module. The SDK is
imported on first use.
"""

from collections.abc import Sequence
from importlib import import_module
from typing import Any

import cv2
import numpy as np

from haptigraph.errors import BadInput, MissingExtra
from haptigraph.messages import CameraStamp, Image

__all__ = ["CLOCKS", "colour_stream", "find_device", "image_of", "info_of", "sdk", "stamp_of"]

TO_BGR = {
    "bgr8": None,
    "rgb8": cv2.COLOR_RGB2BGR,
    "yuyv": cv2.COLOR_YUV2BGR_YUYV,
    "uyvy": cv2.COLOR_YUV2BGR_UYVY,
}
"""Conversion of each supported format to BGR, in order of preference."""

CLOCKS = {"global_time": "global", "hardware_clock": "hardware", "system_time": "system"}
"""The SDK's time stamp domains, and their names in `CameraStamp`."""


def sdk() -> Any:
    """Return the module pyrealsense2.

    Raises:
        MissingExtra: If it is not installed.
        BadInput: If a system library is missing.
    """
    try:
        return import_module("pyrealsense2")
    except ModuleNotFoundError:
        raise MissingExtra("a RealSense camera", "realsense") from None
    except ImportError as error:
        problem = f"pyrealsense2 cannot be loaded ({error}); on Debian: apt-get install libusb-1.0-0"
        raise BadInput(problem) from None


def find_device(serial: str) -> Any:
    """Return the camera with a serial number, or the only connected one.

    Raises:
        BadInput: If it is not connected, or several are and none was chosen.
    """
    devices = {info_of(device, "serial_number"): device for device in sdk().context().query_devices()}
    connected = f"connected: {', '.join(devices)}" if devices else "no RealSense camera is connected"
    if serial and serial not in devices:
        raise BadInput(f"no RealSense camera {serial}; {connected}")
    if not devices:
        raise BadInput(f"{connected}; connect one")
    if not serial and len(devices) > 1:
        raise BadInput(f"several RealSense cameras are {connected}; choose one with realsense:SERIAL")
    return devices[serial or next(iter(devices))]


def colour_stream(
    name: str, device: Any, size_px: tuple[int, int] | None = None, rate_hz: float | None = None
) -> tuple[Any, Any]:
    """Return the sensor that streams colour images, and the stream.

    Raises:
        BadInput: If there is none, or none of this size and rate.
    """
    found = _colour_streams(device)
    for sensor, profile in found:
        if size_px in (None, _size_px(profile)) and rate_hz in (None, profile.fps()):
            return sensor, profile
    if size_px is None or not found:
        raise BadInput(f"{name} has no colour images")
    requested = f"{size_px[0]} x {size_px[1]} px at {rate_hz:g}/s"
    raise BadInput(f"{name} has no colour images of {requested}; supported are {_formatted(found)}")


def _formatted(found: Sequence[tuple[Any, Any]]) -> str:
    """Format streams as "640 x 480 at 15, 30; 1280 x 720 at 5"."""
    rates: dict[tuple[int, int], set[int]] = {}
    for _, profile in found:
        rates.setdefault(_size_px(profile), set()).add(profile.fps())
    return "; ".join(
        f"{width} x {height} at {', '.join(map(str, sorted(rates[width, height])))}"
        for width, height in sorted(rates)
    )


def _colour_streams(device: Any) -> Sequence[tuple[Any, Any]]:
    """Return sensors and their colour streams, those without conversion first."""
    rs = sdk()
    found = [
        (sensor, profile.as_video_stream_profile())
        for sensor in device.query_sensors()
        for profile in sensor.get_stream_profiles()
        if profile.stream_type() == rs.stream.color and profile.format().name in TO_BGR
    ]
    formats = list(TO_BGR)
    return sorted(found, key=lambda pair: formats.index(pair[1].format().name))


def _size_px(profile: Any) -> tuple[int, int]:
    return profile.width(), profile.height()


def image_of(frame: Any) -> Image:
    """Return a frame's pixels, (h, w, 3) BGR."""
    pixels = np.asanyarray(frame.get_data())
    conversion = TO_BGR[frame.get_profile().format().name]
    if conversion is None:
        return np.array(pixels, np.uint8)
    if pixels.ndim == 2:  # the SDK delivers YUV as 16-bit pixels
        pixels = pixels.view(np.uint8).reshape(*pixels.shape, 2)
    return np.asarray(cv2.cvtColor(pixels, conversion), np.uint8)


def stamp_of(frame: Any, arrived_ns: int | None = None) -> CameraStamp:
    """Return the camera's time stamp of a frame."""
    clock = CLOCKS[frame.get_frame_timestamp_domain().name]
    return CameraStamp(clock, round(frame.get_timestamp() * 1e6), arrived_ns)


def info_of(device: Any, key: str) -> str:
    """Return a property of a device, such as its "serial_number"; empty if it has none."""
    info = getattr(sdk().camera_info, key)
    return str(device.get_info(info)) if device.supports(info) else ""
