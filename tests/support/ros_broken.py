"""A program that publishes invalid messages, until it is killed."""

import sys
import threading
from dataclasses import dataclass

from cyclonedds.idl import IdlStruct, types
from cyclonedds.idl.annotations import autoid, final

from haptigraph.ros2.node import Node
from haptigraph.ros2.types import CompressedImage, Header, Image, Joy, Time


@dataclass
@final
@autoid("sequential")
class NotUtf8(IdlStruct, typename="std_msgs::msg::dds_::String_"):
    """Declared as a String, with arbitrary bytes."""

    data: types.sequence[types.uint8]


@dataclass
@final
@autoid("sequential")
class TooShort(IdlStruct, typename="sensor_msgs::msg::dds_::Joy_"):
    """Declared as a Joy with billions of axes, and without any."""

    header: Header
    axes: types.uint32


@dataclass
@final
@autoid("sequential")
class Endless(IdlStruct, typename="sensor_msgs::msg::dds_::Image_"):
    """Declared as an Image of gigabytes, and truncated after its header."""

    header: Header
    sizes: types.array[types.uint32, 2]


BOMB = b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR" + (60_000).to_bytes(4, "big") * 2 + b"\x08\x02\0\0\0" + bytes(64)
HEAD = Header(Time(2**31 - 1, 2**32 - 1), "camera" * 100)
MESSAGES = {
    ("/text", NotUtf8): [NotUtf8(list(b"\xff\xfe\0")), NotUtf8(list(b"fine\0"))],
    ("/joy", TooShort): [TooShort(HEAD, 4_000_000_000)],
    ("/joy", Joy): [
        Joy(HEAD, [], []),
        Joy(HEAD, [float("nan")] * 8, [1] * 12),
        Joy(HEAD, [float("inf")] * 8, [1] * 12),
        Joy(HEAD, [1e30, -1e30], [2**31 - 1] * 6),
    ],
    ("/camera/image", Endless): [Endless(HEAD, [2**32 - 1, 2**32 - 1])],
    ("/camera/image", Image): [
        Image(HEAD, 0, 0, "bgr8", 0, 0, b""),
        Image(HEAD, 2**32 - 1, 2**32 - 1, "bgr8", 0, 2**32 - 1, b"123"),
        Image(HEAD, 270, 480, "bgr8", 0, 1440, b"too few"),
        Image(HEAD, 270, 480, "bgr8", 0, 1, bytes(270)),
        Image(HEAD, 270, 480, "yuv422", 0, 960, bytes(270 * 960)),
    ],
    ("/camera/image", CompressedImage): [
        CompressedImage(HEAD, "jpeg", b""),
        CompressedImage(HEAD, "jpeg", b"\xff\xd8\xff\xc0\0\x11\x08" + b"\x01\x0e\x01\xe0" + bytes(40)),
        CompressedImage(HEAD, "png", BOMB),
        CompressedImage(HEAD, "tiff", bytes(range(256)) * 8),
    ],
}


def main() -> None:
    node, tick = Node(), threading.Event()
    publishers = [(node.publisher(topic, kind), messages) for (topic, kind), messages in MESSAGES.items()]
    sys.stdout.write("publishing\n")
    sys.stdout.flush()
    while True:
        for publisher, messages in publishers:
            for message in messages:
                publisher.send(message)
        tick.wait(0.02)


if __name__ == "__main__":
    main()
