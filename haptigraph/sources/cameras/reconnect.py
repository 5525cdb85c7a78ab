"""Read the newest image of a camera, and reconnect after it disconnects.

A thread reads the camera, so that the loop never waits for a driver. A camera that delivers nothing is
reported once, closed, and reopened with increasing delays.
"""

import threading
from collections.abc import Callable
from typing import NamedTuple, Protocol

from haptigraph.errors import SourceLost
from haptigraph.messages import CameraStamp, Capture, DepthImage, Image
from haptigraph.stages import Source

__all__ = ["RETRY_S", "Camera", "CameraImage", "LiveSource"]

RETRY_S = (0.5, 1.0, 2.0, 5.0)
FAILURES_UNTIL_LOST = 3
CLOSE_TIMEOUT_S = 2.0  # a driver may hang; the process must not


class CameraImage(NamedTuple):
    """One image of a camera."""

    image: Image
    stamp_ns: int
    """When it was taken, on the run's clock."""
    camera: CameraStamp | None = None
    """The camera's own time stamp."""
    depth: DepthImage | None = None


class Camera(Protocol):
    """An opened camera. Only one thread uses it."""

    rate_hz: float
    """Images per second that it delivers."""
    notes: tuple[str, ...]
    """What the user should know about it, a sentence each."""

    def take(self) -> CameraImage | None:
        """Wait for the next image, at most a few seconds; return None or raise any error if there is none."""
        ...

    def close(self) -> None:
        """Release the camera."""
        ...


class LiveSource(Source):
    """Read a camera, and reopen it when it is lost.

    Args:
        name: For messages, as the user wrote it: "camera:0".
        open_camera: Opens the camera, every time; raises BadInput if it cannot.

    Raises:
        BadInput: If it cannot be opened now.
    """

    is_live = True

    def __init__(self, name: str, open_camera: Callable[[], Camera]) -> None:
        self._name, self._open = name, open_camera
        self._changed = threading.Condition()
        self._newest: Capture | None = None
        self._lost = ""
        self._index = -1
        self._closing = threading.Event()
        camera = open_camera()
        self.rate_hz, self.notes = camera.rate_hz, camera.notes
        self._thread = threading.Thread(
            target=self._keep_reading, args=(camera,), name="haptigraph-camera", daemon=True
        )
        self._thread.start()

    def read(self, timeout_s: float) -> Capture | None:
        """Return the newest image that was not returned yet.

        Raises:
            SourceLost: Once, when the camera is lost.
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
        self._thread.join(CLOSE_TIMEOUT_S)

    def _keep_reading(self, camera: Camera | None) -> None:
        while camera is not None:
            reason = self._read_until_lost(camera)
            self._close(camera)
            if self._closing.is_set():
                return
            self._report(f"{self._name} delivers no images{reason}; trying to get it back")
            camera = self._reopened()

    def _read_until_lost(self, camera: Camera) -> str:
        """Read images until the camera fails; return the reason, if there is one."""
        failures, reason = 0, ""
        while failures < FAILURES_UNTIL_LOST and not self._closing.is_set():
            try:
                image, reason = camera.take(), ""
            except Exception as error:  # a driver may raise anything; the loop reports it
                image, reason = None, f" ({error})"
            failures = 0 if image else failures + 1
            if image:
                self._put(image)
        return reason

    def _reopened(self) -> Camera | None:
        """Reopen the camera; None if the run ends first."""
        tries = 0
        while not self._closing.wait(RETRY_S[min(tries, len(RETRY_S) - 1)]):
            try:
                return self._open()
            except Exception:  # a driver may raise anything; the loss is already reported
                tries += 1
        return None

    def _close(self, camera: Camera) -> None:
        try:
            camera.close()
        except Exception as error:  # closing a disconnected camera may fail
            self._report(f"{self._name} does not close ({error})")

    def _put(self, image: CameraImage) -> None:
        with self._changed:
            self._index += 1
            self._newest = Capture(
                self._index, image.stamp_ns, image.image, camera=image.camera, depth=image.depth
            )
            self._changed.notify()

    def _report(self, message: str) -> None:
        with self._changed:
            self._lost, self._newest = message, None
            self._changed.notify()
