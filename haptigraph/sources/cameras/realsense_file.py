"""Images from a recording of the RealSense SDK, with the camera's time stamps.

Reads all colour images, however slowly they are consumed.
"""

import queue
import threading
from pathlib import Path
from typing import Any, TypeAlias

from haptigraph.errors import BadInput, EndOfSource
from haptigraph.messages import CameraStamp, Capture, Image
from haptigraph.sources.cameras.realsense_sdk import colour_stream, image_of, sdk, stamp_of
from haptigraph.stages import Source

__all__ = ["RealsenseFile"]

Item: TypeAlias = tuple[Image, CameraStamp] | Exception | None
"""An image and its stamp, an error, or None at the end."""

QUEUE_SIZE = 4
POLL_S = 0.1
BEGIN_S = 2.0  # within which the SDK delivers a first image


class RealsenseFile(Source):
    """Read the colour images of a recording of the SDK: .db3, or .bag of versions before 2.59.

    No image is dropped; stamps are the camera's own, from 0.

    Args:
        path: The file.

    Raises:
        MissingExtra: If the SDK is not installed.
        BadInput: If it cannot be read or contains no colour images.
    """

    is_live = False

    def __init__(self, path: str | Path) -> None:
        self._path = Path(path)
        if not self._path.is_file():
            raise BadInput("no such file", path)
        rs = sdk()
        self._ready: queue.Queue[Item] = queue.Queue(QUEUE_SIZE)
        self._closed, self._began, self._ended = threading.Event(), threading.Event(), False
        self._index, self._first_ns = -1, 0
        try:
            self._context = rs.context()  # must outlive the device
            self._device = self._context.load_device(str(path))
            self._device.set_real_time(False)
            self._device.set_status_changed_callback(self._on_status)
            self._sensor, profile = colour_stream(str(path), self._device)
            self.rate_hz = float(profile.fps())
            self._sensor.open(profile)
            self._sensor.start(self._on_frame)
        except RuntimeError as error:
            reason = str(error).rpartition(": ")[2]
            raise BadInput(f"not a file that the RealSense SDK can read ({reason})", path) from None

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
        self._began.wait(BEGIN_S)  # stopped earlier, the SDK's thread may spin for ever
        self._sensor.stop()
        self._sensor.close()

    def _on_frame(self, frame: Any) -> None:
        """Receive one frame in the SDK's thread."""
        try:
            self._put((image_of(frame), stamp_of(frame)))
        except Exception as error:  # which the SDK would swallow
            self._put(error)

    def _on_status(self, status: Any) -> None:
        """Receive the end of the file, which follows the last frame."""
        if status == sdk().playback_status.stopped:
            self._put(None)

    def _put(self, item: Item) -> None:
        """Block the SDK while the queue is full."""
        self._began.set()
        while not self._closed.is_set():
            try:
                return self._ready.put(item, timeout=POLL_S)
            except queue.Full:
                continue
