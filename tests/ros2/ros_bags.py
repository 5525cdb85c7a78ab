"""Write ROS 2 bags of images with rosbags' own writer."""

from pathlib import Path

import numpy as np
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from haptigraph.recording.codec import encode_jpeg

STORE = get_typestore(Stores.ROS2_HUMBLE)
FIRST_NS, INTERVAL_NS = 1_700_000_000_000_000_000, 33_000_000
STORAGES = {"mcap": StoragePlugin.MCAP, "db3": StoragePlugin.SQLITE3}
COMPRESSIONS = {"": CompressionMode.NONE} | {
    mode.name.lower(): mode for mode in CompressionMode if mode.value > 1
}


def header(stamp_ns):
    time_type, header_type = (
        STORE.types[name] for name in ("builtin_interfaces/msg/Time", "std_msgs/msg/Header")
    )
    return header_type(time_type(*divmod(stamp_ns, 10**9)), "camera")


def raw(image, stamp_ns, encoding="bgr8"):
    height, width = image.shape[:2]
    kind = STORE.types["sensor_msgs/msg/Image"]
    return kind(header(stamp_ns), height, width, encoding, 0, image.strides[0], image.reshape(-1))


def compressed(data, stamp_ns):
    kind = STORE.types["sensor_msgs/msg/CompressedImage"]
    return kind(header(stamp_ns), "jpeg", np.frombuffer(data, np.uint8))


def text(words, stamp_ns):
    return STORE.types["std_msgs/msg/String"](words)


def write_bag(folder: Path, topics: dict[str, list], *, storage="mcap", compression="", late_ns=5_000_000):
    """Write messages by topic, one every INTERVAL_NS; bytes are written as they are.

    Returns the path of the bag's folder.
    """
    writer = Writer(folder, version=9, storage_plugin=STORAGES[storage])
    writer.set_compression(COMPRESSIONS[compression], CompressionFormat.ZSTD)
    with writer:
        for topic, messages in topics.items():
            kind = next(message.__msgtype__ for message in messages if not isinstance(message, bytes))
            connection = writer.add_connection(topic, kind, typestore=STORE)
            for number, message in enumerate(messages):
                data = message if isinstance(message, bytes) else STORE.serialize_cdr(message, kind)
                writer.write(connection, FIRST_NS + number * INTERVAL_NS + late_ns, data)
    return folder


def images_bag(folder, images, **options):
    """A bag with raw images on one topic, and something else on another."""
    stamps_ns = [FIRST_NS + number * INTERVAL_NS for number in range(len(images))]
    messages = [raw(image, stamp_ns) for image, stamp_ns in zip(images, stamps_ns, strict=True)]
    notes = [text("a note", 0)]
    return write_bag(folder, {"/camera/image_raw": messages, "/notes": notes}, **options)


def jpegs(images, start_ns=FIRST_NS):
    return [
        compressed(encode_jpeg(image, 90), start_ns + number * INTERVAL_NS)
        for number, image in enumerate(images)
    ]
