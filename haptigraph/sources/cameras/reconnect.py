"""Keep a camera going: always its newest image, and back again after it went away.

A thread takes images from the camera and hands over the newest; the loop never waits for a driver. A camera
that delivers nothing is reported once, closed, and opened again, ever less often. Knows no driver.
"""

import threading
from collections.abc import Callable
from typing import NamedTuple, Protocol

from haptigraph.errors import SourceLost
from haptigraph.messages import CameraStamp, Capture, Image

__all__ = ["RETRY_S", "Camera", "LiveSource", "Shot"]

RETRY_S = (0.5, 1.0, 2.0, 5.0)
FAILURES_UNTIL_LOST = 3
CLOSE_TIMEOUT_S = 2.0  # a driver may hang; the process must not


class Shot(NamedTuple):
    """One image of a camera."""

    image: Image
    stamp_ns: int
    """When it was taken, on the run's clock."""
    camera: CameraStamp | None = None
    """What the camera itself says about that."""


class Camera(Protocol):
    """An opened camera. Only one thread uses it."""

    rate_hz: float
    """Images per second that it gives."""
    notes: tuple[str, ...]
    """What the user should know of it, a sentence each."""

    def take(self) -> Shot | None:
        """Wait for the next image, at most some seconds; None if there was none. Any error means the same."""
        ...

    def close(self) -> None:
        """Give the camera back."""
        ...


class LiveSource:
    """Read a camera through whatever opens it.

    Args:
        name: For messages, as the user wrote it: "camera:0".
        open_camera: Opens it, also again; raises BadInput where that does not work.

    Raises:
        BadInput: If it cannot be opened now.
    """

    is_live = True
    registration = None

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
            target=self._keep_going, args=(camera,), name="haptigraph-camera", daemon=True
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
        """Give the camera back."""
        self._closing.set()
        self._thread.join(CLOSE_TIMEOUT_S)

    def _keep_going(self, camera: Camera | None) -> None:
        while camera is not None:
            why = self._hand_over(camera)
            self._close(camera)
            if self._closing.is_set():
                return
            self._report(f"{self._name} delivers no images{why}; trying to get it back")
            camera = self._opened_again()

    def _hand_over(self, camera: Camera) -> str:
        """Hand over images until the camera fails; return why, where it says so."""
        failures, why = 0, ""
        while failures < FAILURES_UNTIL_LOST and not self._closing.is_set():
            try:
                shot, why = camera.take(), ""
            except Exception as error:  # a driver may do anything, and the loop must hear of it
                shot, why = None, f" ({error})"
            failures = 0 if shot else failures + 1
            if shot:
                self._put(shot)
        return why

    def _opened_again(self) -> Camera | None:
        """Open the camera once it is back; None when the run ends before."""
        tries = 0
        while not self._closing.wait(RETRY_S[min(tries, len(RETRY_S) - 1)]):
            try:
                return self._open()
            except Exception:  # a driver may do anything while its camera comes back; it was told already
                tries += 1
        return None

    def _close(self, camera: Camera) -> None:
        try:
            camera.close()
        except Exception as error:  # one that is gone may not like to be closed
            self._report(f"{self._name} does not close ({error})")

    def _put(self, shot: Shot) -> None:
        with self._changed:
            self._index += 1
            self._newest = Capture(self._index, shot.stamp_ns, shot.image, camera=shot.camera)
            self._changed.notify()

    def _report(self, message: str) -> None:
        with self._changed:
            self._lost, self._newest = message, None
            self._changed.notify()
