"""Images from a file that the RealSense SDK recorded, with the stamps the camera gave them then.

Turns colour frames of the SDK's playback into captures, all of them, at whatever pace they are read.
"""

import queue
import threading
from pathlib import Path
from typing import Any, TypeAlias

from haptigraph.errors import BadInput, EndOfSource
from haptigraph.messages import CameraStamp, Capture, Image
from haptigraph.sources.cameras.realsense_sdk import colour_stream, image_of, sdk, stamp_of

__all__ = ["RealsenseFile"]

Item: TypeAlias = tuple[Image, CameraStamp] | Exception | None
"""An image and its stamp, or why there is none, or None: the end."""

AHEAD = 4
POLL_S = 0.1


class RealsenseFile:
    """Read the colour images of a recording of the SDK: .db3, or .bag of versions before 2.59.

    All images are read, whatever time it takes; stamps are the camera's own, from 0.

    Args:
        path: The file.

    Raises:
        MissingExtra: If the SDK is not installed.
        BadInput: If it cannot be read or holds no colour images.
    """

    is_live = False
    registration = None

    def __init__(self, path: str | Path) -> None:
        self._path = Path(path)
        if not self._path.is_file():
            raise BadInput("no such file", path)
        rs = sdk()
        self._ready: queue.Queue[Item] = queue.Queue(AHEAD)
        self._closed, self._ended = threading.Event(), False
        self._index, self._first_ns = -1, 0
        try:
            self._context = rs.context()  # must outlive the device
            self._device = self._context.load_device(str(path))
            self._device.set_real_time(False)
            self._device.set_status_changed_callback(self._heard)
            self._sensor, profile = colour_stream(str(path), self._device)
            self.rate_hz = float(profile.fps())
            self._sensor.open(profile)
            self._sensor.start(self._hand_over)
        except RuntimeError as error:
            why = str(error).rpartition(": ")[2]
            raise BadInput(f"not a file that the RealSense SDK can read ({why})", path) from None

    def read(self, timeout_s: float) -> Capture | None:
        """Return the next image, or None if the SDK has not decoded it in time."""
        try:
            item = None if self._ended else self._ready.get(timeout=timeout_s)
        except queue.Empty:
            return None
        if item is None:
            self._ended = True
            raise EndOfSource
        if isinstance(item, Exception):
            raise BadInput(str(item), self._path, f"image {self._index + 1}")
        image, camera = item
        self._index += 1
        if not self._index:
            self._first_ns = camera.stamp_ns
        return Capture(self._index, camera.stamp_ns - self._first_ns, image, camera=camera)

    def close(self) -> None:
        """Close the file."""
        if self._closed.is_set():
            return
        self._closed.set()
        self._sensor.stop()
        self._sensor.close()

    def _hand_over(self, frame: Any) -> None:
        """Take one frame from the SDK's thread."""
        try:
            self._put((image_of(frame), stamp_of(frame)))
        except Exception as error:  # the SDK would swallow it
            self._put(error)

    def _heard(self, status: Any) -> None:
        """Take the end, which comes after the last frame was handed over."""
        if status == sdk().playback_status.stopped:
            self._put(None)

    def _put(self, item: Item) -> None:
        """Hold the SDK up while the loop is behind."""
        while not self._closed.is_set():
            try:
                return self._ready.put(item, timeout=POLL_S)
            except queue.Full:
                continue
