"""Turn a camera's own stamps into the run's clock. Knows no camera.

A camera stamps images by a clock that began who knows when and goes a little fast or slow. What this machine
can see is when an image arrives. No image arrives before it was taken, and the luckiest of many has hardly
waited anywhere; so the offset between the clocks is the smallest (arrival - stamp) of the last images. The
jitter of USB, driver and threads is gone from the stamps then; the way that every image must go (exposure,
transfer) is not in them, and stays unknown here.
"""

from collections import deque

from haptigraph.messages import CameraStamp

__all__ = ["Timebase"]

WINDOW = 300  # images; at 30 images/s a crystal that is 50 ppm off makes 0.5 ms of that
JUMP_NS = 500_000_000  # nothing waits so long: someone set the camera's clock


class Timebase:
    """The offset between one camera's clock and the run's, learnt as images arrive."""

    def __init__(self) -> None:
        self._clock = ""
        self._offsets_ns: deque[int] = deque(maxlen=WINDOW)
        self._last_ns: int | None = None

    def on_run(self, camera: CameraStamp) -> int:
        """Return when an image was taken [ns], on the run's clock; later than the one before.

        Args:
            camera: The image's stamp; `arrived_ns` must be known.

        Raises:
            ValueError: If it is not.
        """
        if camera.arrived_ns is None:
            raise ValueError("a stamp without arrival says nothing of the run's clock")
        offset_ns = camera.arrived_ns - camera.stamp_ns
        if camera.clock != self._clock or (self._offsets_ns and offset_ns - min(self._offsets_ns) > JUMP_NS):
            self._clock = camera.clock
            self._offsets_ns.clear()
        self._offsets_ns.append(offset_ns)
        stamp_ns = camera.stamp_ns + min(self._offsets_ns)
        if self._last_ns is not None:
            stamp_ns = max(stamp_ns, self._last_ns + 1)
        self._last_ns = stamp_ns
        return stamp_ns
