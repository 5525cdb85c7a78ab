"""Images from an Intel RealSense camera, stamped by the camera.

Turns colour frames of the SDK into captures; depth is not read. The D405 of the paper has no colour sensor of
its own: its colour comes from the depth imagers, so whoever changes depth's exposure changes the picture. A
software device of the SDK is opened the same way as a real one.
"""

from collections.abc import Callable
from typing import Any

from haptigraph.clock import Clock
from haptigraph.errors import BadInput
from haptigraph.sources.cameras.realsense_sdk import (
    CLOCKS,
    colour_stream,
    find_device,
    image_of,
    info_of,
    sdk,
    stamp_of,
)
from haptigraph.sources.cameras.reconnect import LiveSource, Shot
from haptigraph.sources.cameras.timebase import Timebase

__all__ = ["RealsenseCamera", "RealsenseSource"]

FIRST_MS = 5000  # a camera needs so long to start, at most
NEXT_MS = 500
QUEUED = 2  # so that the newest never waits behind older ones


class RealsenseSource(LiveSource):
    """Read a RealSense camera.

    Args:
        serial: Its serial number; empty: the only one there is.
        size_px: (width, height) of its colour images; the camera must have it.
        rate_hz: Images per second; the camera must have it, too.
        clock: The run's; arrivals are measured on it, and stamps are made from the camera's own.
        find: Finds the device; other than on the bus in tests only.

    Raises:
        MissingExtra: If the SDK is not installed.
        BadInput: If there is no such camera, or it has no such images.
    """

    def __init__(
        self,
        serial: str = "",
        *,
        size_px: tuple[int, int],
        rate_hz: float,
        clock: Clock,
        find: Callable[[str], Any] | None = None,
    ) -> None:
        name, timebase = f"realsense:{serial}".rstrip(":"), Timebase()

        def open_camera() -> RealsenseCamera:
            nonlocal serial
            try:
                device = (find or find_device)(serial)
            except RuntimeError as error:
                raise BadInput(f"{name} cannot be looked for ({error})") from None
            camera = RealsenseCamera(name, device, size_px, rate_hz, clock, timebase)
            serial = info_of(device, "serial_number")  # the same one again, should it go away
            return camera

        super().__init__(name, open_camera)


class RealsenseCamera:
    """An opened camera whose first image was seen. Arguments as for `RealsenseSource`."""

    def __init__(
        self,
        name: str,
        device: Any,
        size_px: tuple[int, int],
        rate_hz: float,
        clock: Clock,
        timebase: Timebase,
    ) -> None:
        rs = sdk()
        self._clock, self._timebase = clock, timebase
        self._frames = rs.frame_queue(QUEUED)
        self.rate_hz = rate_hz
        try:
            self._sensor, profile = colour_stream(name, device, size_px, rate_hz)
            if self._sensor.supports(rs.option.global_time_enabled):
                self._sensor.set_option(rs.option.global_time_enabled, 1)
            self._sensor.open(profile)
            self._sensor.start(self._frames)
            self._first: Any = self._frames.wait_for_frame(FIRST_MS)
        except RuntimeError as error:
            self.close()
            raise BadInput(f"{name} opens but gives no image ({error})") from None
        clock_name = CLOCKS[self._first.get_frame_timestamp_domain().name]
        who = f"{info_of(device, 'name')}, serial number {info_of(device, 'serial_number')}"
        asked = f"{size_px[0]} x {size_px[1]} px, {rate_hz:g} images/s, as asked"
        self.notes: tuple[str, ...] = (f"{name} is {who}, and gives {asked}; its {clock_name} clock stamps",)

    def take(self) -> Shot | None:
        """Wait for the next image; None if it does not come."""
        frame, self._first = self._first, None
        if frame is None:
            there, frame = self._frames.try_wait_for_frame(NEXT_MS)
            if not there:
                return None
        camera = stamp_of(frame, self._clock.now_ns())
        return Shot(image_of(frame), self._timebase.on_run(camera), camera)

    def close(self) -> None:
        """Give the camera back."""
        self._first = None
        for part in ("stop", "close"):
            try:
                getattr(self._sensor, part)()
            except (AttributeError, RuntimeError):  # it never began, or is gone
                continue
