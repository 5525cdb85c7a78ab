"""Images from a UVC camera, or a network camera, through OpenCV, stamped when they were taken.

Turns grabs of cv2.VideoCapture into shots. On Linux the driver stamps images itself, on the very clock of the
run; elsewhere an image is stamped when it is grabbed, before it is decoded. Knows no registration.
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
from haptigraph.sources.cameras.reconnect import LiveSource, Shot
from haptigraph.sources.naming import camera_device
from haptigraph.sources.opencv import open_capture

__all__ = ["CameraSource", "Grabber", "UvcCamera"]

OLDEST_NS = 500_000_000  # a driver's stamp that is older than this is on another clock


class Grabber(Protocol):
    """The part of cv2.VideoCapture that is used."""

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
        which: Its number, 0 first; or the path of its device (/dev/v4l/by-id/...); or a stream's address
            (http://..., rtsp://...).
        size_px: (width, height) to ask for; what the camera gives instead is told in `notes`.
        rate_hz: Images per second to ask for.
        fourcc: Format to ask for, four letters ("MJPG"); empty: the driver's own choice.
        clock: Stamps the images.
        open_camera: Opens it; other than OpenCV in tests only.

    Raises:
        BadInput: If there is no such camera, or it gives no image.
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
    """An opened camera, of which one image was seen. Arguments as for `CameraSource`."""

    def __init__(
        self, name: str, grabber: Grabber, size_px: tuple[int, int], rate_hz: float, fourcc: str, clock: Clock
    ) -> None:
        self._grabber, self._clock = grabber, clock
        is_stream = "://" in name
        try:
            if not grabber.isOpened():
                raise BadInput(f"{name} cannot be opened; {_present(is_stream)}")
            if not is_stream:
                _ask(grabber, size_px, rate_hz, fourcc)
            first = self.take()
            if first is None:
                raise BadInput(f"{name} opens but gives no image; is it used by another program?")
        except BaseException:
            grabber.release()
            raise
        height, width = first.image.shape[:2]
        given_hz = 0.0 if is_stream else grabber.get(cv2.CAP_PROP_FPS)
        self.rate_hz = given_hz if 1 <= given_hz <= 1000 else rate_hz
        asked = _said(size_px, rate_hz, fourcc)
        given = _said((width, height), given_hz, _letters(grabber.get(cv2.CAP_PROP_FOURCC)) if fourcc else "")
        answer = f"gives {asked}, as asked" if given == asked else f"was asked for {asked} and gives {given}"
        if is_stream:
            answer = f"gives {width} x {height} px; a stream cannot be asked for anything else"
        self.notes: tuple[str, ...] = (f"{name} {answer}",)

    def take(self) -> Shot | None:
        """Wait for the next image; None if the driver has none."""
        if not self._grabber.grab():
            return None
        arrived_ns = self._clock.now_ns()
        camera = self._driver_stamp(arrived_ns)
        there, image = self._grabber.retrieve()
        if not there or image is None:
            return None
        stamp_ns = camera.stamp_ns if camera else arrived_ns
        return Shot(np.asarray(image, np.uint8), stamp_ns, camera)

    def close(self) -> None:
        """Give the camera back."""
        self._grabber.release()

    def _driver_stamp(self, arrived_ns: int) -> CameraStamp | None:
        """Return what Video4Linux says of the image just grabbed, if it is on this machine's clock."""
        if self._grabber.getBackendName() != "V4L2":
            return None
        stamp_ns = round(self._grabber.get(cv2.CAP_PROP_POS_MSEC) * 1e6)
        if not 0 <= arrived_ns - stamp_ns <= OLDEST_NS:
            return None
        return CameraStamp("driver", stamp_ns, arrived_ns)


def _ask(grabber: Grabber, size_px: tuple[int, int], rate_hz: float, fourcc: str) -> None:
    """Set what a driver can be asked for; the format first, since sizes depend on it."""
    if fourcc:
        grabber.set(cv2.CAP_PROP_FOURCC, cv2.VideoWriter.fourcc(*fourcc))
    grabber.set(cv2.CAP_PROP_FRAME_WIDTH, size_px[0])
    grabber.set(cv2.CAP_PROP_FRAME_HEIGHT, size_px[1])
    grabber.set(cv2.CAP_PROP_FPS, rate_hz)


def _said(size_px: tuple[int, int], rate_hz: float, fourcc: str) -> str:
    rate = f"{rate_hz:g} images/s" if rate_hz > 0 else "images at an unknown rate"
    return ", ".join(part for part in (f"{size_px[0]} x {size_px[1]} px", rate, fourcc) if part)


def _letters(code: float) -> str:
    """Return the four letters of OpenCV's number for a format."""
    letters = int(code).to_bytes(4, "little", signed=True).decode("ascii", "replace")
    return letters if letters.isalnum() else "an unknown format"


def _present(is_stream: bool) -> str:
    if is_stream:
        return "does something answer there?"
    if not sys.platform.startswith("linux"):
        return "is it plugged in, and used by no other program?"
    devices = sorted(str(path) for path in Path("/dev").glob("video*"))
    return f"there are {', '.join(devices)}" if devices else "there is no camera on this machine"
