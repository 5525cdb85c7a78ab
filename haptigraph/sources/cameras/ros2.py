"""The newest image of a ROS 2 topic, with the time stamp of its header.

Accepts sensor_msgs/Image and CompressedImage. Other messages are rejected and reported, and never disturb the
loop.
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
from haptigraph.ros2.node import Node, buffer_hint, checked_topic
from haptigraph.ros2.qos import IMAGE_DEPTH
from haptigraph.sources.cameras.ros2_images import compressed_image, raw_image
from haptigraph.stages import Source

__all__ = ["Ros2Source"]

SILENCE_TIMEOUT_NS = 1_000_000_000  # after this time without an image the topic is reported as lost
MAX_AGE_NS = 1_000_000_000  # the stamp of an older image is from a clock that is not synchronised
MAX_AHEAD_NS = 20_000_000
IMAGE_TYPES = {cls.__idl_typename__.replace(".", "::") for cls in (types.Image, types.CompressedImage)}


class Ros2Source(Source):
    """Read a topic of images.

    Args:
        topic: ROS name of the topic.
        size_px: (width, height) as registered; other images are rejected.
        rate_hz: Nominal images per second.
        clock: The run's clock.

    Raises:
        BadInput: If the topic's name is not valid, or the network cannot be joined.
        MissingExtra: If cyclonedds is not installed.
    """

    is_live = True

    def __init__(self, topic: str, *, size_px: tuple[int, int], rate_hz: float, clock: Clock) -> None:
        self.rate_hz = rate_hz
        self.notes = (hint,) if (hint := buffer_hint()) else ()
        self._topic, self._size_px, self._clock = checked_topic(topic), size_px, clock
        self._changed = threading.Condition()
        self._newest: Capture | None = None
        self._rejected = ""
        self._has_reported_stamps = False
        self._index = -1
        self._stamp_ns = -1
        self._arrived_ns: int | None = clock.now_ns()
        """When an image last arrived; None once the silence was reported."""
        self._node = Node()
        subscribe = partial(
            self._node.subscribe, self._topic, reject=self._reject, depth=IMAGE_DEPTH, is_large=True
        )
        subscribe(types.Image, self._take_raw)
        subscribe(types.CompressedImage, self._take_compressed)

    def read(self, timeout_s: float) -> Capture | None:
        """Return the newest image that was not returned yet.

        Raises:
            SourceLost: Once, when no images arrive or they cannot be used.
        """
        with self._changed:
            if self._newest is None:
                self._changed.wait(timeout_s)
            capture, self._newest = self._newest, None
            rejected, self._rejected = self._rejected, ""
            silence_ns = 0 if self._arrived_ns is None else self._clock.now_ns() - self._arrived_ns
            if silence_ns > SILENCE_TIMEOUT_NS:
                self._arrived_ns = None
        if capture is not None:
            return replace(capture, faults=(Fault("source", rejected),)) if rejected else capture
        if rejected:
            raise SourceLost(rejected)
        if silence_ns > SILENCE_TIMEOUT_NS:
            raise SourceLost(self._silence_reason())
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
                raise ValueError("an image older than the previous one")
            self._index += 1
            self._stamp_ns, self._arrived_ns = stamp_ns, now_ns
            camera = CameraStamp("ros", header.stamp.ns, now_ns) if header.stamp.ns else None
            self._newest = Capture(self._index, stamp_ns, image, encoded, camera=camera)
            self._changed.notify()

    def _stamped(self, header: types.Header, now_ns: int) -> int:
        """Return when an image was taken, on the run's clock; its arrival, if the header is implausible."""
        stamp_ns = header.stamp.ns - offset_ns(time.time_ns, self._clock)
        age_ns = now_ns - stamp_ns
        if -MAX_AHEAD_NS <= age_ns <= MAX_AGE_NS:
            return min(stamp_ns, now_ns)
        if not self._has_reported_stamps:
            self._has_reported_stamps = True
            stamp = f"is stamped {abs(age_ns) / 1e9:.1f} s in the {'past' if age_ns > 0 else 'future'}"
            found = stamp if header.stamp.ns else "has no stamp"
            self._rejected = f"ros2:{self._topic}: an image {found}; such images are stamped on arrival"
        return now_ns

    def _reject(self, problem: str) -> None:
        with self._changed:
            self._rejected = f"ros2:{self._topic}: rejected {problem}"
            self._changed.notify()

    def _silence_reason(self) -> str:
        published: dict[str, Any] = self._node.published()
        topic = f"ros2:{self._topic} (ROS domain {self._node.domain})"
        kind = published.get(self._topic)
        if kind in IMAGE_TYPES:
            hint = buffer_hint() or "if it is raw, subscribe to its compressed topic, or check the network"
            return f"{topic} is published, but no image arrives; {hint}"
        images = [name for name, kind in published.items() if kind in IMAGE_TYPES]
        others = f"images are published on {', '.join(images)}" if images else "no images are published"
        if kind is None:
            return f"{topic} is silent; {others}"
        return f"{topic} has messages of type {kind}, not images; {others}"
