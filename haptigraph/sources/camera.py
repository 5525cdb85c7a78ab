"""Images from a UVC camera through OpenCV, always the newest, stamped when they arrive.

A thread grabs; a camera that goes away is reported and tried again, ever less often.
"""

import sys
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Protocol

import cv2
import numpy as np

from haptigraph.clock import Clock
from haptigraph.errors import BadInput, SourceLost
from haptigraph.messages import Capture, Image
from haptigraph.sources.opencv import open_capture

__all__ = ["CameraSource", "Grabber"]

RETRY_S = (0.5, 1.0, 2.0, 5.0)
FAILURES_UNTIL_LOST = 3


class Grabber(Protocol):
    """The part of cv2.VideoCapture that is used."""

    def isOpened(self) -> bool: ...  # noqa: N802, D102
    def read(self) -> tuple[bool, Image]: ...  # noqa: D102
    def set(self, propId: int, value: float) -> bool: ...  # noqa: N803, D102
    def get(self, propId: int) -> float: ...  # noqa: N803, D102
    def release(self) -> None: ...  # noqa: D102


class CameraSource:
    """Read a camera.

    Args:
        number: Of the camera, 0 first.
        size_px: (width, height) to ask for; what the camera then delivers is checked by perception.
        rate_hz: Images per second to ask for.
        clock: Stamps the images.
        open_camera: Opens it; other than OpenCV in tests only.

    Raises:
        BadInput: If there is no such camera.
    """

    is_live = True
    registration = None

    def __init__(
        self,
        number: int,
        *,
        size_px: tuple[int, int],
        rate_hz: float,
        clock: Clock,
        open_camera: Callable[[int], Grabber] = open_capture,  # type: ignore[assignment]
    ) -> None:
        self.rate_hz = rate_hz
        self._number, self._size_px, self._clock, self._open = number, size_px, clock, open_camera
        self._changed = threading.Condition()
        self._newest: Capture | None = None
        self._lost = ""
        self._index = -1
        self._closing = threading.Event()
        camera = self._opened()
        if camera is None:
            raise BadInput(f"camera:{number} cannot be opened; {_present()}")
        self._thread = threading.Thread(
            target=self._grab, args=(camera,), name="haptigraph-camera", daemon=True
        )
        self._thread.start()

    def read(self, timeout_s: float) -> Capture | None:
        """Return the newest image that was not returned yet.

        Raises:
            SourceLost: Once, when the camera has gone away.
        """
        with self._changed:
            if self._newest is None and not self._lost:
                self._changed.wait(timeout_s)
            if self._lost:
                message, self._lost = self._lost, ""
                raise SourceLost(message)
            capture, self._newest = self._newest, None
            return capture

    def close(self) -> None:
        """Release the camera."""
        self._closing.set()
        self._thread.join(timeout=2.0)

    def _opened(self) -> Grabber | None:
        camera = self._open(self._number)
        if not camera.isOpened():
            camera.release()
            return None
        camera.set(cv2.CAP_PROP_FOURCC, cv2.VideoWriter.fourcc(*"MJPG"))
        camera.set(cv2.CAP_PROP_FRAME_WIDTH, self._size_px[0])
        camera.set(cv2.CAP_PROP_FRAME_HEIGHT, self._size_px[1])
        camera.set(cv2.CAP_PROP_FPS, self.rate_hz)
        return camera

    def _grab(self, camera: Grabber | None) -> None:
        failures = 0
        while not self._closing.is_set():
            there, image = camera.read() if camera is not None else (False, None)
            if there and image is not None:
                failures = 0
                self._put(image)
                continue
            failures += 1
            if camera is not None and failures >= FAILURES_UNTIL_LOST:
                camera.release()
                camera = None
                self._report(f"camera:{self._number} delivers no images; trying to get it back")
            if camera is None:
                self._closing.wait(RETRY_S[min(failures - FAILURES_UNTIL_LOST, len(RETRY_S) - 1)])
                camera = self._opened()
        if camera is not None:
            camera.release()

    def _put(self, image: Image) -> None:
        with self._changed:
            self._index += 1
            self._newest = Capture(self._index, self._clock.now_ns(), np.asarray(image, np.uint8))
            self._changed.notify()

    def _report(self, message: str) -> None:
        with self._changed:
            self._lost, self._newest = message, None
            self._changed.notify()


def _present() -> str:
    if not sys.platform.startswith("linux"):
        return "is it plugged in, and used by no other program?"
    devices = sorted(str(path) for path in Path("/dev").glob("video*"))
    return f"there are {', '.join(devices)}" if devices else "there is no camera on this machine"
