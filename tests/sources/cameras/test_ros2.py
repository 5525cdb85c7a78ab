import re
import time

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from ros_network import until

pytest.importorskip("cyclonedds")

from cyclonedds.builtin import BuiltinTopicDcpsSubscription

from haptigraph.clock import MonotonicClock
from haptigraph.errors import BadInput, SourceLost
from haptigraph.recording.codec import decode, encode_jpeg, encode_png
from haptigraph.ros2.endpoints import Endpoints
from haptigraph.ros2.types import CompressedImage, Header, Image, String, Time
from haptigraph.sources.cameras.ros2 import Ros2Source
from haptigraph.sources.cameras.ros2_images import CHANNELS, compressed_image, raw_image
from haptigraph.stages import Source

SIZE_PX = (8, 6)
PIXELS = np.random.default_rng(1).integers(0, 256, (6, 8, 4), np.uint8)
CONVERSIONS = {
    "bgr8": cv2.COLOR_BGRA2BGR,
    "8UC3": cv2.COLOR_BGRA2BGR,
    "rgb8": cv2.COLOR_BGRA2RGB,
    "rgba8": cv2.COLOR_BGRA2RGBA,
}


def header(stamp_ns=0):
    return Header(Time.from_ns(stamp_ns), "camera")


def raw(encoding, *, padding=0, stamp_ns=0):
    pixels = PIXELS
    if CHANNELS[encoding] == 1:
        pixels = PIXELS[:, :, :1]
    elif encoding in CONVERSIONS:
        pixels = cv2.cvtColor(PIXELS, CONVERSIONS[encoding])
    rows = pixels.reshape(6, -1)
    data = np.hstack([rows, np.full((6, padding), 255, np.uint8)])
    return Image(header(stamp_ns), 6, 8, encoding, 0, data.shape[1], data.tobytes())


@pytest.mark.parametrize("encoding", CHANNELS)
@pytest.mark.parametrize("padding", [0, 5])
def test_every_encoding_becomes_the_same_pixels(encoding, padding):
    image = raw_image(raw(encoding, padding=padding), SIZE_PX)
    expected = PIXELS[:, :, 0] if CHANNELS[encoding] == 1 else PIXELS[:, :, :3]
    assert np.array_equal(image, expected)
    assert image.flags["C_CONTIGUOUS"]


@given(
    width=st.integers(0, 2**32 - 1),
    height=st.integers(0, 2**32 - 1),
    step=st.integers(0, 2**32 - 1),
    encoding=st.sampled_from([*CHANNELS, "mono16", ""]),
    data=st.binary(max_size=300),
)
def test_a_raw_image_has_the_registered_size_or_is_rejected(width, height, step, encoding, data):
    try:
        image = raw_image(Image(header(), height, width, encoding, 0, step, data), SIZE_PX)
    except ValueError as error:
        assert len(str(error)) < 200
    else:
        assert image.shape[:2] == (6, 8)


@pytest.mark.parametrize("encode", [encode_png, lambda image: encode_jpeg(image, 90)])
@pytest.mark.parametrize("channels", [1, 3])
def test_a_compressed_image_is_decoded(encode, channels):
    data = encode(PIXELS[:, :, 0] if channels == 1 else PIXELS[:, :, :3])
    assert np.array_equal(compressed_image(CompressedImage(header(), "any", data), SIZE_PX), decode(data))
    with pytest.raises(ValueError, match="an image of 8 x 6 px instead of 6 x 8 px"):
        compressed_image(CompressedImage(header(), "any", data), (6, 8))


@given(data=st.binary(max_size=400), start=st.sampled_from([b"", b"\xff\xd8", b"\x89PNG\r\n\x1a\n"]))
def test_arbitrary_bytes_are_rejected(data, start):
    with pytest.raises(ValueError):
        compressed_image(CompressedImage(header(), "jpeg", start + data), SIZE_PX)


@given(at=st.integers(2, 400), cut=st.integers(0, 400))
def test_a_damaged_image_has_the_registered_size_or_is_rejected(at, cut):
    data = bytearray(encode_jpeg(PIXELS[:, :, :3], 90))
    data[at % len(data)] ^= 0xFF
    try:
        image = compressed_image(CompressedImage(header(), "jpeg", bytes(data[: len(data) - cut])), SIZE_PX)
    except ValueError:
        return
    assert image.shape[:2] == (6, 8)


def test_a_few_bytes_cannot_allocate_gigabytes():
    bomb = b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR" + (60_000).to_bytes(4, "big") * 2
    with pytest.raises(ValueError, match="an image of 60000 x 60000 px instead of 8 x 6 px"):
        compressed_image(CompressedImage(header(), "png", bomb + bytes(100)), SIZE_PX)


@pytest.fixture
def source(ros_network):
    source = Ros2Source("camera/small", size_px=SIZE_PX, rate_hz=30.0, clock=MonotonicClock())
    yield source
    source.close()
    source.close()


@pytest.fixture
def camera(source, peer):
    """Publishes on the source's topic, once the source has adapted: messages of before may be lost."""
    subscriptions = Endpoints(peer.node.participant, BuiltinTopicDcpsSubscription)

    def publisher(message_type):
        publisher = peer.publisher("/camera/small", message_type)
        until(lambda: subscriptions.are_reliable("rt/camera/small"), "the source does not adapt")
        return publisher

    yield publisher
    subscriptions.close()


def test_an_image_is_stamped_when_it_was_taken(source, camera):
    assert isinstance(source, Source)
    publisher = camera(Image)
    taken_ns, stamp_ns = time.monotonic_ns() - 200_000_000, time.time_ns() - 200_000_000
    publisher.send(raw("bgr8", stamp_ns=stamp_ns))
    capture = source.read(30.0)
    assert (capture.camera.clock, capture.camera.stamp_ns) == ("ros", stamp_ns)
    assert capture.stamp_ns <= capture.camera.arrived_ns <= time.monotonic_ns()
    assert abs(capture.stamp_ns - taken_ns) < 20_000_000
    assert (capture.index, capture.faults, capture.encoded) == (0, (), None)
    assert np.array_equal(capture.image, PIXELS[:, :, :3])
    assert source.read(0.01) is None


def test_a_compressed_image_keeps_its_bytes(source, camera):
    data = encode_jpeg(PIXELS[:, :, :3], 90)
    camera(CompressedImage).send(CompressedImage(header(time.time_ns()), "jpeg", data))
    capture = source.read(30.0)
    assert capture.encoded == data
    assert np.array_equal(capture.image, decode(data))


@pytest.mark.parametrize(
    ("ahead_s", "problem"),
    [
        (-3600, "is stamped 3600.0 s in the past"),
        (60, "is stamped 60.0 s in the future"),
        (None, "has no stamp"),
    ],
)
def test_an_implausible_stamp_is_reported_once_and_replaced_by_the_arrival(source, camera, ahead_s, problem):
    publisher, faults = camera(Image), []
    for _ in range(3):
        before_ns = time.monotonic_ns()
        publisher.send(raw("bgr8", stamp_ns=0 if ahead_s is None else time.time_ns() + ahead_s * 10**9))
        capture = source.read(30.0)
        assert before_ns <= capture.stamp_ns <= time.monotonic_ns()
        assert (capture.camera is None) == (ahead_s is None)
        faults += [fault.message for fault in capture.faults]
    assert len(faults) == 1
    assert problem in faults[0].replace("3599.9", "3600.0").replace("59.9", "60.0")


def test_the_newest_image_is_read_and_missed_ones_are_counted(source, camera):
    publisher = camera(Image)
    for number in range(10):
        publisher.send(raw("bgr8", stamp_ns=time.time_ns()))
        until(lambda number=number: source._index == number, "an image was lost")
    assert source.read(1.0).index == 9


def test_an_image_out_of_order_is_rejected(source, camera):
    publisher = camera(Image)
    publisher.send(raw("bgr8", stamp_ns=time.time_ns()))
    assert source.read(30.0).index == 0
    publisher.send(raw("bgr8", stamp_ns=time.time_ns() - 500_000_000))
    with pytest.raises(SourceLost, match="rejected an image older than the previous one"):
        source.read(30.0)


def test_a_rejected_message_is_reported_with_the_next_image_or_alone(source, camera):
    publisher = camera(Image)
    wrong = raw("bgr8")
    wrong.encoding = "mono16"
    publisher.send(wrong)
    with pytest.raises(
        SourceLost, match="ros2:/camera/small: rejected encoding 'mono16'; supported are mono8, 8UC1, bgr8"
    ):
        source.read(30.0)
    publisher.send(wrong)
    publisher.send(raw("bgr8", stamp_ns=time.time_ns()))
    until(lambda: source._newest and source._rejected, "nothing arrived")
    (fault,) = source.read(0.0).faults
    assert "rejected encoding 'mono16'" in fault.message


@pytest.mark.parametrize("topic", ["", "camera image", "7"])
def test_an_invalid_topic_name_is_rejected(ros_network, topic):
    with pytest.raises(BadInput, match="is no ROS topic"):
        Ros2Source(topic, size_px=SIZE_PX, rate_hz=30.0, clock=MonotonicClock())


def test_silence_is_reported_once_with_the_topics_that_have_images(source, peer):
    peer.node.publisher("/camera/other", Image)
    until(lambda: "/camera/other" in source._node.published(), "the topic is not discovered")
    source._arrived_ns -= 2_000_000_000
    with pytest.raises(SourceLost) as lost:
        source.read(0.0)
    assert "ros2:/camera/small (ROS domain " in str(lost.value)
    assert re.search(r"is silent; images are published on .*/camera/other", str(lost.value))
    assert source.read(0.0) is None


def test_a_topic_without_images_is_reported_with_those_that_have_images(source, peer):
    peer.node.publisher("/camera/small", String)
    peer.node.publisher("/camera/left", Image)
    until(
        lambda: {"/camera/small", "/camera/left"} <= set(source._node.published()),
        "the topics are not discovered",
    )
    source._arrived_ns -= 2_000_000_000
    with pytest.raises(SourceLost) as lost:
        source.read(0.0)
    problem = r"has messages of type std_msgs::msg::dds_::String_, not images; images are published on .*/camera/left"
    assert re.search(problem, str(lost.value))
