"""Convert a camera's time stamps to the run's clock.

A camera's clock has an unknown offset and a small drift; this machine observes only when an image arrives. No
image arrives before it was taken, and the fastest of many was hardly delayed; so the offset between the
clocks is estimated as the minimum of (arrival - stamp) over the last images. This removes the jitter of USB,
driver and threads. The constant part of the latency (exposure, transfer) remains unknown.
"""

from collections import deque

from haptigraph.messages import CameraStamp

__all__ = ["Timebase"]

WINDOW = 300  # images; at 30 images/s a drift of 50 ppm amounts to 0.5 ms
MAX_DELAY_NS = 500_000_000  # a longer one means that the camera's clock was set


class Timebase:
    """Running estimate of the offset between a camera's clock and the run's."""

    def __init__(self) -> None:
        self._clock = ""
        self._offsets_ns: deque[int] = deque(maxlen=WINDOW)
        self._last_ns: int | None = None

    def to_run_clock(self, camera: CameraStamp) -> int:
        """Return when an image was taken [ns], on the run's clock; later than the previous one.

        Args:
            camera: The image's stamp, with `arrived_ns`.

        Raises:
            ValueError: If `arrived_ns` is None.
        """
        if camera.arrived_ns is None:
            raise ValueError("a stamp without arrival time cannot be converted to the run's clock")
        offset_ns = camera.arrived_ns - camera.stamp_ns
        was_set = self._offsets_ns and offset_ns - min(self._offsets_ns) > MAX_DELAY_NS
        if camera.clock != self._clock or was_set:
            self._clock = camera.clock
            self._offsets_ns.clear()
        self._offsets_ns.append(offset_ns)
        stamp_ns = camera.stamp_ns + min(self._offsets_ns)
        if self._last_ns is not None:
            stamp_ns = max(stamp_ns, self._last_ns + 1)
        self._last_ns = stamp_ns
        return stamp_ns
