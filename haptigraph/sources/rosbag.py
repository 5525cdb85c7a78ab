"""Images from a ROS 2 bag, .mcap or .db3, with the time stamps of their headers.

Accepts the messages of `ros2:TOPIC`. A damaged message costs its image, and becomes a fault of the next one.
"""

from collections.abc import Generator
from importlib import import_module
from itertools import islice, pairwise
from pathlib import Path
from statistics import median
from typing import Any, NamedTuple

from haptigraph.errors import BadInput, EndOfSource, MissingExtra
from haptigraph.messages import CameraStamp, Capture, Fault, Image
from haptigraph.sources.cameras.ros2_images import compressed_image, image_size_px, raw_image
from haptigraph.stages import Source

__all__ = ["RosbagSource"]

RAW = "sensor_msgs/msg/Image"
IMAGE_TYPES = (RAW, "sensor_msgs/msg/CompressedImage")
TOPIC = "?topic="
MAX_IMAGE_PX = 2**26  # a larger image is a damaged message
RATE_IMAGES = 12  # whose intervals give the rate


class _Message(NamedTuple):
    """An image as it is in the bag, and its time."""

    recorded_ns: int
    content: Any
    """The message, or why it cannot be decoded."""

    @property
    def stamp_ns(self) -> int:
        """The stamp in the header; 0 if there is none."""
        return 0 if isinstance(self.content, str) else _stamp_ns(self.content)


class RosbagSource(Source):
    """Play one image topic of a bag.

    Args:
        argument: PATH or PATH?topic=TOPIC; the path of a bag's folder, or of a single .mcap or .db3 file.
            Without topic: the only one that has images.
        rate_hz: Images per second, if the bag has fewer than two.

    Raises:
        MissingExtra: If rosbags is not installed.
        BadInput: If the bag cannot be read, or does not have such a topic.
    """

    is_live = False

    def __init__(self, argument: str, rate_hz: float) -> None:
        path, _, topic = argument.partition(TOPIC)
        self._path, self._reader = Path(path), _opened(Path(path))
        try:
            self._connections = self._image_connections(topic)
            stamps_ns = [message.stamp_ns for message in islice(self._messages(), RATE_IMAGES)]
        except BaseException:
            self._reader.close()
            raise
        intervals_ns = [after - before for before, after in pairwise(stamps_ns) if after > before > 0]
        self.rate_hz = 1e9 / median(intervals_ns) if intervals_ns else rate_hz
        self._images = self._messages()
        self._faults: tuple[Fault, ...] = ()
        self._size_px: tuple[int, int] | None = None
        self._index, self._number = -1, -1
        self._first_ns = self._last_ns = 0
        self._ended = self._has_reported_stamps = False

    def read(self, timeout_s: float) -> Capture | None:
        """Return the next image that can be decoded."""
        while not self._ended:
            try:
                message = next(self._images, None)
            except Exception as error:  # rosbags raises anything for a damaged file
                self._reject(f"cannot be read beyond message {self._number} ({_reason(error)})")
                message = None
            if message is None:
                return self._last_capture()
            self._number += 1
            capture = self._capture(message)
            if capture is not None:
                return capture
        raise EndOfSource

    def close(self) -> None:
        """Close the bag. May be called twice."""
        self._ended = True
        if self._reader.stack is not None:
            self._images.close()
            self._reader.close()

    def _image_connections(self, topic: str) -> list[Any]:
        connections = [each for each in self._reader.connections if each.msgtype in IMAGE_TYPES]
        topics = sorted({each.topic for each in connections})
        if not topics:
            raise BadInput(f"has no topic of {' or '.join(IMAGE_TYPES)}", self._path)
        if topic not in topics and (topic or len(topics) > 1):
            problem = f"has no images on {topic}" if topic else "has several image topics"
            raise BadInput(
                f"{problem}; choose one of {', '.join(topics)}, for example "
                f"'rosbag:{self._path}{TOPIC}{topics[0]}'",
                self._path,
            )
        return [each for each in connections if each.topic == (topic or topics[0])]

    def _messages(self) -> Generator[_Message, None, None]:
        for connection, recorded_ns, data in self._reader.messages(connections=self._connections):
            try:
                content = self._reader.deserialize(data, connection.msgtype)
            except Exception as error:  # of whichever field is damaged
                content = _reason(error)
            yield _Message(recorded_ns, content)

    def _capture(self, message: _Message) -> Capture | None:
        """Return the capture of a message; None if it is rejected: the next capture has the fault."""
        if isinstance(message.content, str):
            self._reject(f"message {self._number} cannot be decoded ({message.content})")
            return None
        try:
            image, encoded = self._decoded(message.content)
        except ValueError as error:
            self._reject(f"rejected message {self._number}: {error}")
            return None
        stamp_ns = message.stamp_ns or message.recorded_ns
        if not message.stamp_ns and not self._has_reported_stamps:
            self._has_reported_stamps = True
            self._reject("images have no stamp; the time at which they were recorded is used")
        if self._index >= 0 and stamp_ns <= self._last_ns:
            self._reject(f"rejected message {self._number}: an image not later than the previous one")
            return None
        self._index += 1
        if not self._index:
            self._first_ns = stamp_ns
        self._last_ns = stamp_ns
        faults, self._faults = self._faults, ()
        camera = CameraStamp("ros", message.stamp_ns) if message.stamp_ns else None
        return Capture(self._index, stamp_ns - self._first_ns, image, encoded, faults=faults, camera=camera)

    def _decoded(self, content: Any) -> tuple[Image, bytes | None]:
        size_px = self._size_px or image_size_px(content)
        if size_px[0] * size_px[1] > MAX_IMAGE_PX:
            raise ValueError("an image of {} x {} px, which is too large".format(*size_px))
        if hasattr(content, "encoding"):
            image, encoded = raw_image(content, size_px), None
        else:
            encoded = content.data.tobytes()
            image = compressed_image(content, size_px)
        self._size_px = size_px
        return image, encoded

    def _reject(self, problem: str) -> None:
        self._faults = (*self._faults, Fault("source", f"{self._path}: {problem}"))

    def _last_capture(self) -> Capture:
        """Return what remains to be reported at the end.

        Raises:
            EndOfSource: If nothing does.
            BadInput: If there was no image.
        """
        self.close()
        if self._index < 0:
            reason = self._faults[0].message if self._faults else f"{self._path}: no message on this topic"
            raise BadInput(f"contains no image that can be used ({reason})", self._path)
        if not self._faults:
            raise EndOfSource
        return Capture(self._index, self._last_ns - self._first_ns + 1, None, faults=self._faults)


def _opened(path: Path) -> Any:
    """Return the open reader of a bag."""
    try:
        highlevel, typesys = (import_module(f"rosbags.{name}") for name in ("highlevel", "typesys"))
    except ModuleNotFoundError:
        raise MissingExtra(f"{path}: a ROS bag", "rosbag") from None
    if not path.exists():
        raise BadInput("no such file or folder; expected rosbag:PATH or 'rosbag:PATH?topic=TOPIC'", path)
    if path.is_dir() and not (path / "metadata.yaml").is_file():
        raise BadInput(
            "a bag's folder has metadata.yaml; name one of its files, or `ros2 bag reindex` it", path
        )
    try:
        # Bags of ROS before Iron contain no definitions of their messages.
        reader = highlevel.AnyReader(
            [path], default_typestore=typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)
        )
        reader.open()
    except Exception as error:  # rosbags raises anything for a damaged file
        raise BadInput(f"not a ROS 2 bag that rosbags can read ({_reason(error)})", path) from None
    return reader


def _stamp_ns(content: Any) -> int:
    stamp = content.header.stamp
    return int(stamp.sec) * 1_000_000_000 + int(stamp.nanosec)


def _reason(error: Exception) -> str:
    return str(error) or type(error).__name__
