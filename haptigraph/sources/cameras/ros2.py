"""Images from a ROS 2 topic, always the newest, stamped when the camera took them.

Takes sensor_msgs/Image and CompressedImage, whichever is published under the name. What else comes is refused
and told, and never disturbs the loop.
"""

import threading
import time
from functools import partial
from typing import Any

from msgspec.structs import replace

from haptigraph.clock import Clock, offset_ns
from haptigraph.errors import SourceLost
from haptigraph.messages import CameraStamp, Capture, Fault, Image
from haptigraph.ros2 import types
from haptigraph.ros2.node import Node, checked_topic
from haptigraph.sources.cameras.ros2_images import compressed_image, raw_image

__all__ = ["Ros2Source"]

SILENT_NS = 1_000_000_000  # a topic that was silent for so long is told to be lost
MOST_AGE_NS = 1_000_000_000  # an image that looks older was stamped by a clock that differs
MOST_WAITING = 2
MOST_LEAD_NS = 20_000_000
IMAGE_TYPES = {cls.__idl_typename__.replace(".", "::") for cls in (types.Image, types.CompressedImage)}


class Ros2Source:
    """Read a topic of images.

    Args:
        topic: ROS name of the topic.
        size_px: (width, height) as registered; other images are refused.
        rate_hz: Images per second, nominally.
        clock: The run's clock.

    Raises:
        BadInput: If it is no topic, or the network cannot be joined.
        MissingExtra: If cyclonedds is not installed.
    """

    is_live = True
    registration = None

    def __init__(self, topic: str, *, size_px: tuple[int, int], rate_hz: float, clock: Clock) -> None:
        self.rate_hz = rate_hz
        self._topic, self._size_px, self._clock = checked_topic(topic), size_px, clock
        self._changed = threading.Condition()
        self._newest: Capture | None = None
        self._refused = self._clock_told = ""
        self._index = -1
        self._stamp_ns = -1
        self._heard_ns: int | None = clock.now_ns()
        """When an image last came; None once the silence was told."""
        self._node = Node()
        hear = partial(self._node.subscribe, self._topic, refuse=self._refuse, depth=MOST_WAITING)
        hear(types.Image, self._take_raw)
        hear(types.CompressedImage, self._take_compressed)

    def read(self, timeout_s: float) -> Capture | None:
        """Return the newest image that was not returned yet.

        Raises:
            SourceLost: Once, when images stay away or cannot be used.
        """
        with self._changed:
            if self._newest is None:
                self._changed.wait(timeout_s)
            capture, self._newest = self._newest, None
            refused, self._refused = self._refused, ""
            silent = self._heard_ns is not None and self._clock.now_ns() - self._heard_ns > SILENT_NS
            if silent:
                self._heard_ns = None
        if capture is not None:
            return replace(capture, faults=(Fault("source", refused),)) if refused else capture
        if refused:
            raise SourceLost(refused)
        if silent:
            raise SourceLost(self._why_silent())
        return None

    def close(self) -> None:
        """Leave the network."""
        self._node.close()

    def _take_raw(self, message: types.Image) -> None:
        self._put(message.header, raw_image(message, self._size_px))

    def _take_compressed(self, message: types.CompressedImage) -> None:
        self._put(message.header, compressed_image(message, self._size_px), message.data)

    def _put(self, header: types.Header, image: Image, encoded: bytes | None = None) -> None:
        with self._changed:
            now_ns = self._clock.now_ns()
            stamp_ns = self._stamped(header, now_ns)
            if stamp_ns <= self._stamp_ns:
                raise ValueError("an image older than the one before it")
            self._index += 1
            self._stamp_ns, self._heard_ns = stamp_ns, now_ns
            camera = CameraStamp("ros", header.stamp.ns, now_ns) if header.stamp.ns else None
            self._newest = Capture(self._index, stamp_ns, image, encoded, camera=camera)
            self._changed.notify()

    def _stamped(self, header: types.Header, now_ns: int) -> int:
        """Return when an image was taken, on the run's clock; on arrival, if its stamp cannot be so."""
        stamp_ns = header.stamp.ns - offset_ns(time.time_ns, self._clock)
        age_ns = now_ns - stamp_ns
        if -MOST_LEAD_NS <= age_ns <= MOST_AGE_NS:
            return min(stamp_ns, now_ns)
        if not self._clock_told:
            self._clock_told = "carries no stamp"
            if header.stamp.ns:
                self._clock_told = f"was stamped {abs(age_ns) / 1e9:.1f} s {'ago' if age_ns > 0 else 'ahead'}"
            self._refused = (
                f"ros2:{self._topic}: an image {self._clock_told}; all such are stamped on arrival"
            )
        return now_ns

    def _refuse(self, problem: str) -> None:
        with self._changed:
            self._refused = f"ros2:{self._topic}: refused {problem}"
            self._changed.notify()

    def _why_silent(self) -> str:
        published: dict[str, Any] = self._node.published()
        where = f"ros2:{self._topic} (ROS domain {self._node.domain})"
        kind = published.get(self._topic)
        if kind in IMAGE_TYPES:
            return f"{where} is published, but no image comes"
        images = [name for name, kind in published.items() if kind in IMAGE_TYPES]
        seen = f"images are published on {', '.join(images)}" if images else "no images are published at all"
        return f"{where} is silent; {seen}" if kind is None else f"{where} carries {kind}, no images; {seen}"
