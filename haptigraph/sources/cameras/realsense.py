"""Images from an Intel RealSense camera, with the camera's time stamps.

Reads the SDK's colour stream, and depth if it is asked for. The D405 of the paper has no separate colour
sensor: its colour comes from the depth imagers, so the exposure of depth changes the image. A software device
of the SDK opens like a real one.
"""

from collections.abc import Callable
from typing import Any

from haptigraph.clock import Clock
from haptigraph.errors import BadInput
from haptigraph.messages import DepthImage
from haptigraph.projection import DepthCamera
from haptigraph.sources.cameras.realsense_frames import ColourFrames
from haptigraph.sources.cameras.realsense_sdk import (
    CLOCKS,
    colour_stream,
    find_device,
    image_of,
    info_of,
    sdk,
    stamp_of,
)
from haptigraph.sources.cameras.reconnect import CameraImage, LiveSource
from haptigraph.sources.cameras.timebase import Timebase

__all__ = ["RealsenseCamera", "RealsenseSource"]

FIRST_IMAGE_TIMEOUT_MS = 5000  # a camera takes at most this long to start
IMAGE_TIMEOUT_MS = 500


class RealsenseSource(LiveSource):
    """Read a RealSense camera.

    Args:
        serial: Its serial number; empty: the only connected camera.
        size_px: (width, height) of its colour images; the camera must support it.
        rate_hz: Images per second; the camera must support it.
        clock: The run's clock, to which the camera's stamps are converted.
        depth: Whether to read depth images, too.
        find: Finds the device; tests replace it.

    Raises:
        MissingExtra: If the SDK is not installed.
        BadInput: If there is no such camera, or it does not support this size and rate, or depth.
    """

    def __init__(
        self,
        serial: str = "",
        *,
        size_px: tuple[int, int],
        rate_hz: float,
        clock: Clock,
        depth: bool = False,
        find: Callable[[str], Any] | None = None,
    ) -> None:
        name, timebase = f"realsense:{serial}".rstrip(":"), Timebase()

        depth_camera: DepthCamera | None = None

        def open_camera() -> RealsenseCamera:
            nonlocal serial, depth_camera
            try:
                device = (find or find_device)(serial)
            except RuntimeError as error:
                raise BadInput(f"{name}: the search for cameras failed ({error})") from None
            camera = RealsenseCamera(name, device, size_px, rate_hz, clock, timebase, depth=depth)
            depth_camera = camera.depth_camera
            serial = info_of(device, "serial_number")  # to reconnect to the same camera
            return camera

        super().__init__(name, open_camera)
        self.depth_camera = depth_camera


class RealsenseCamera:
    """An opened camera that has delivered its first image. Arguments as for `RealsenseSource`."""

    def __init__(
        self,
        name: str,
        device: Any,
        size_px: tuple[int, int],
        rate_hz: float,
        clock: Clock,
        timebase: Timebase,
        *,
        depth: bool = False,
    ) -> None:
        rs = sdk()
        self._clock, self._timebase = clock, timebase
        self._frames: ColourFrames | None = None
        self.rate_hz = rate_hz
        try:
            sensor, profile = colour_stream(name, device, size_px, rate_hz)
            if sensor.supports(rs.option.global_time_enabled):
                sensor.set_option(rs.option.global_time_enabled, 1)
            self._frames = ColourFrames(name, device, (sensor, profile), with_depth=depth)
            self.depth_camera = self._frames.depth_camera
            self._frames.start()
            self._first: tuple[Any, DepthImage | None] | None = self._frames.wait(FIRST_IMAGE_TIMEOUT_MS)
            if self._first is None:
                raise RuntimeError(f"none in {FIRST_IMAGE_TIMEOUT_MS / 1e3:g} s")
        except RuntimeError as error:
            self.close()
            raise BadInput(f"{name} opens but delivers no image ({error})") from None
        clock_name = CLOCKS[self._first[0].get_frame_timestamp_domain().name]
        device_name = f"{info_of(device, 'name')}, serial number {info_of(device, 'serial_number')}"
        delivers = f"{size_px[0]} x {size_px[1]} px, {rate_hz:g} images/s, as requested"
        delivers += ", and depth" if depth else ""
        note = f"{name} is {device_name}; it delivers {delivers}, stamped by its {clock_name} clock"
        self.notes: tuple[str, ...] = (note,)

    def take(self) -> CameraImage | None:
        """Wait for the next image; None after the timeout."""
        found, self._first = self._first, None
        if found is None and self._frames is not None:
            found = self._frames.wait(IMAGE_TIMEOUT_MS)
        if found is None:
            return None
        frame, depth = found
        camera = stamp_of(frame, self._clock.now_ns())
        return CameraImage(image_of(frame), self._timebase.to_run_clock(camera), camera, depth)

    def close(self) -> None:
        """Release the camera."""
        self._first = None
        if self._frames is not None:
            self._frames.close()
