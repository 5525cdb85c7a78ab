"""Images from a UVC or network camera through OpenCV, stamped when they were taken.

On Linux the driver stamps images, on the run's own clock; elsewhere an image is stamped when it is grabbed,
before it is decoded.
"""

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Protocol

import cv2
import numpy as np

from haptigraph.clock import Clock
from haptigraph.errors import BadInput
from haptigraph.messages import CameraStamp, Image
from haptigraph.opencv import open_capture
from haptigraph.sources.cameras.reconnect import CameraImage, LiveSource
from haptigraph.sources.naming import camera_device

__all__ = ["CameraSource", "Grabber", "UvcCamera"]

MAX_AGE_NS = 500_000_000  # an older stamp of the driver is from another clock


class Grabber(Protocol):
    """The subset of cv2.VideoCapture that is used."""

    def isOpened(self) -> bool: ...  # noqa: N802, D102
    def getBackendName(self) -> str: ...  # noqa: N802, D102
    def grab(self) -> bool: ...  # noqa: D102
    def retrieve(self) -> tuple[bool, Image]: ...  # noqa: D102
    def set(self, propId: int, value: float) -> bool: ...  # noqa: N803, D102
    def get(self, propId: int) -> float: ...  # noqa: N803, D102
    def release(self) -> None: ...  # noqa: D102


class CameraSource(LiveSource):
    """Read a camera.

    Args:
        which: Its number, from 0; the path of its device (/dev/v4l/by-id/...); or the URL of a stream
            (http://..., rtsp://...).
        size_px: Requested (width, height); `notes` states what the camera delivers instead.
        rate_hz: Requested images per second.
        fourcc: Requested pixel format, four letters ("MJPG"); empty: the driver's default.
        clock: Stamps the images.
        open_camera: Opens the camera; tests replace it.

    Raises:
        BadInput: If there is no such camera, or it delivers no image.
    """

    def __init__(
        self,
        which: str,
        *,
        size_px: tuple[int, int],
        rate_hz: float,
        clock: Clock,
        fourcc: str = "",
        open_camera: Callable[[int | str], Grabber] = open_capture,  # type: ignore[assignment]
    ) -> None:
        name, device = f"camera:{which}", camera_device(which)

        def opened() -> UvcCamera:
            return UvcCamera(name, open_camera(device), size_px, rate_hz, fourcc, clock)

        super().__init__(name, opened)


class UvcCamera:
    """An opened camera that has delivered its first image. Arguments as for `CameraSource`."""

    def __init__(
        self, name: str, grabber: Grabber, size_px: tuple[int, int], rate_hz: float, fourcc: str, clock: Clock
    ) -> None:
        self._grabber, self._clock = grabber, clock
        is_stream = "://" in name
        try:
            if not grabber.isOpened():
                raise BadInput(f"{name} cannot be opened; {_advice(is_stream)}")
            if not is_stream:
                _request(grabber, size_px, rate_hz, fourcc)
            first = self.take()
            if first is None:
                raise BadInput(f"{name} opens but delivers no image; close other programs that use it")
        except BaseException:
            grabber.release()
            raise
        height, width = first.image.shape[:2]
        actual_hz = 0.0 if is_stream else grabber.get(cv2.CAP_PROP_FPS)
        self.rate_hz = actual_hz if 1 <= actual_hz <= 1000 else rate_hz
        actual_fourcc = _letters(grabber.get(cv2.CAP_PROP_FOURCC)) if fourcc else ""
        requested = _formatted(size_px, rate_hz, fourcc)
        actual = _formatted((width, height), actual_hz, actual_fourcc)
        note = f"delivers {actual}, as requested"
        if is_stream:
            note = f"delivers {width} x {height} px; the format of a stream cannot be chosen"
        elif actual != requested:
            note = f"delivers {actual} instead of {requested}"
        self.notes: tuple[str, ...] = (f"{name} {note}",)

    def take(self) -> CameraImage | None:
        """Wait for the next image; None if the driver has none."""
        if not self._grabber.grab():
            return None
        arrived_ns = self._clock.now_ns()
        camera = self._driver_stamp(arrived_ns)
        has_image, image = self._grabber.retrieve()
        if not has_image or image is None:
            return None
        stamp_ns = camera.stamp_ns if camera else arrived_ns
        return CameraImage(np.asarray(image, np.uint8), stamp_ns, camera)

    def close(self) -> None:
        """Release the camera."""
        self._grabber.release()

    def _driver_stamp(self, arrived_ns: int) -> CameraStamp | None:
        """Return Video4Linux's stamp of the image just grabbed, if it is from this machine's clock."""
        if self._grabber.getBackendName() != "V4L2":
            return None
        stamp_ns = round(self._grabber.get(cv2.CAP_PROP_POS_MSEC) * 1e6)
        if not 0 <= arrived_ns - stamp_ns <= MAX_AGE_NS:
            return None
        return CameraStamp("driver", stamp_ns, arrived_ns)


def _request(grabber: Grabber, size_px: tuple[int, int], rate_hz: float, fourcc: str) -> None:
    """Request a video mode from the driver; the format first, because sizes depend on it."""
    if fourcc:
        grabber.set(cv2.CAP_PROP_FOURCC, cv2.VideoWriter.fourcc(*fourcc))
    grabber.set(cv2.CAP_PROP_FRAME_WIDTH, size_px[0])
    grabber.set(cv2.CAP_PROP_FRAME_HEIGHT, size_px[1])
    grabber.set(cv2.CAP_PROP_FPS, rate_hz)


def _formatted(size_px: tuple[int, int], rate_hz: float, fourcc: str) -> str:
    rate = f"{rate_hz:g} images/s" if rate_hz > 0 else "images at an unknown rate"
    return ", ".join(part for part in (f"{size_px[0]} x {size_px[1]} px", rate, fourcc) if part)


def _letters(code: float) -> str:
    """Return the four letters of an OpenCV format code."""
    letters = int(code).to_bytes(4, "little", signed=True).decode("ascii", "replace")
    return letters if letters.isalnum() else "an unknown format"


def _advice(is_stream: bool) -> str:
    if is_stream:
        return "check that a server answers at this URL"
    if not sys.platform.startswith("linux"):
        return "check that it is connected and not used by another program"
    devices = sorted(str(path) for path in Path("/dev").glob("video*"))
    return f"connected: {', '.join(devices)}" if devices else "no camera is connected"
