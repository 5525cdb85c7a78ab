import shutil
import sqlite3
import sys

import numpy as np
import pytest
from helpers import call, drain, refuse

pytest.importorskip("rosbags")

from ros_bags import FIRST_NS, INTERVAL_NS, STORE, compressed, images_bag, jpegs, raw, text, write_bag

from haptigraph.errors import BadInput, MissingExtra
from haptigraph.messages import CameraStamp
from haptigraph.recording.codec import decode, encode_jpeg, encode_png
from haptigraph.sources.rosbag import RosbagSource

IMAGES = list(np.random.default_rng(1).integers(0, 256, (6, 12, 16, 3), np.uint8))


def open_bag(path, topic=""):
    return RosbagSource(f"{path}?topic={topic}" if topic else str(path), 30.0)


def faults(captures):
    return [fault.message for capture in captures for fault in capture.faults]


@pytest.mark.parametrize("storage", ["mcap", "db3"])
@pytest.mark.parametrize("compression", ["", "file", "message", "storage"])
def test_every_storage_and_compression_delivers_the_same_images(tmp_path, storage, compression):
    if (storage, compression) == ("db3", "storage"):
        pytest.skip("sqlite3 has no compression of its own")
    folder = images_bag(tmp_path / "bag", IMAGES, storage=storage, compression=compression)
    source = open_bag(folder)
    captures = drain(source)
    assert [capture.index for capture in captures] == [0, 1, 2, 3, 4, 5]
    assert [capture.stamp_ns for capture in captures] == [number * INTERVAL_NS for number in range(6)]
    assert all(np.array_equal(capture.image, image) for capture, image in zip(captures, IMAGES, strict=True))
    assert captures[2].camera == CameraStamp("ros", FIRST_NS + 2 * INTERVAL_NS)
    assert source.rate_hz == pytest.approx(1e9 / INTERVAL_NS)
    assert faults(captures) == []


@pytest.mark.parametrize("storage", ["mcap", "db3"])
def test_a_single_file_is_a_bag_too(tmp_path, storage):
    folder = images_bag(tmp_path / "bag", IMAGES, storage=storage)
    (file,) = folder.glob(f"*.{storage}")
    assert len(drain(open_bag(file))) == len(IMAGES)


@pytest.mark.parametrize("encode", [encode_png, lambda image: encode_jpeg(image, 90)])
def test_compressed_images_keep_their_bytes(tmp_path, encode):
    data = [encode(image) for image in IMAGES]
    messages = [compressed(each, FIRST_NS + number * INTERVAL_NS) for number, each in enumerate(data)]
    captures = drain(open_bag(write_bag(tmp_path / "bag", {"/camera": messages})))
    assert [capture.encoded for capture in captures] == data
    assert all(
        np.array_equal(capture.image, decode(each)) for capture, each in zip(captures, data, strict=True)
    )


def test_one_of_several_topics_is_chosen_by_name(tmp_path):
    left, right = IMAGES[:3], IMAGES[3:]
    bag = write_bag(tmp_path / "bag", {"/left/image": jpegs(left), "/right/image": jpegs(right)})
    with pytest.raises(BadInput) as caught:
        open_bag(bag)
    assert "has several image topics; choose one of /left/image, /right/image, for example" in str(
        caught.value
    )
    assert f"'rosbag:{bag}?topic=/left/image'" in str(caught.value)
    with pytest.raises(BadInput, match="has no images on /middle; choose one of /left/image, /right/image"):
        open_bag(bag, "/middle")
    captures = drain(open_bag(bag, "/right/image"))
    assert captures[0].encoded == encode_jpeg(right[0], 90)


def test_a_bag_without_images_is_refused(tmp_path):
    bag = write_bag(tmp_path / "bag", {"/notes": [text("a note", 0)]})
    with pytest.raises(
        BadInput, match="has no topic of sensor_msgs/msg/Image or sensor_msgs/msg/CompressedImage"
    ):
        open_bag(bag)


def test_a_damaged_message_costs_its_image_and_is_a_fault_of_the_next(tmp_path):
    messages = jpegs(IMAGES)
    messages[1] = b"\x00\x01\x00\x00\x05"  # CDR that ends in its first field
    messages[2] = compressed(b"no image", FIRST_NS + 2 * INTERVAL_NS)
    messages[4] = compressed(encode_jpeg(IMAGES[4][:8], 90), FIRST_NS + 4 * INTERVAL_NS)
    captures = drain(open_bag(write_bag(tmp_path / "bag", {"/camera": messages})))
    assert [capture.stamp_ns // INTERVAL_NS for capture in captures] == [0, 3, 5]
    assert [capture.index for capture in captures] == [0, 1, 2]
    first, second = captures[1].faults
    assert "message 1 cannot be decoded (" in first.message
    assert second.message.endswith("rejected message 2: 8 bytes that are neither JPEG nor PNG")
    (third,) = captures[2].faults
    assert "rejected message 4: an image of 16 x 8 px instead of 16 x 12 px" in third.message
    assert captures[0].faults == ()


def test_a_damaged_last_message_is_reported_at_the_end(tmp_path):
    messages = [*jpegs(IMAGES[:2]), compressed(b"", FIRST_NS + 2 * INTERVAL_NS)]
    captures = drain(open_bag(write_bag(tmp_path / "bag", {"/camera": messages})))
    assert captures[-1].image is None
    assert captures[-1].stamp_ns == INTERVAL_NS + 1
    assert "rejected message 2: 0 bytes that are neither JPEG nor PNG" in captures[-1].faults[0].message


def test_an_unsupported_encoding_is_refused_with_the_supported_ones(tmp_path):
    messages = [raw(IMAGES[0], FIRST_NS, encoding="bayer_rggb8")]
    source = open_bag(write_bag(tmp_path / "bag", {"/camera": messages}))
    with pytest.raises(
        BadInput, match=r"contains no image that can be used .*encoding 'bayer_rggb8'; supported are"
    ):
        source.read(1.0)
    source.close()


def test_a_gigantic_image_is_rejected_before_it_is_decoded(tmp_path):
    data = bytearray(encode_png(IMAGES[0]))
    data[16:24] = (60_000).to_bytes(4, "big") * 2
    messages = [compressed(bytes(data), FIRST_NS), *jpegs(IMAGES[:1], FIRST_NS + INTERVAL_NS)]
    (capture,) = drain(open_bag(write_bag(tmp_path / "bag", {"/camera": messages})))
    assert "an image of 60000 x 60000 px, which is too large" in capture.faults[0].message


def test_images_without_stamp_have_the_time_at_which_they_were_recorded(tmp_path):
    messages = [compressed(encode_jpeg(image, 90), 0) for image in IMAGES]
    captures = drain(open_bag(write_bag(tmp_path / "bag", {"/camera": messages})))
    assert [capture.stamp_ns // INTERVAL_NS for capture in captures] == [0, 1, 2, 3, 4, 5]
    assert all(capture.camera is None for capture in captures)
    assert len(faults(captures)) == 1
    assert "images have no stamp; the time at which they were recorded is used" in faults(captures)[0]


def test_an_image_out_of_order_is_rejected(tmp_path):
    messages = jpegs(IMAGES[:3])
    captures = drain(open_bag(write_bag(tmp_path / "bag", {"/camera": [messages[i] for i in (0, 2, 1, 2)]})))
    assert [capture.stamp_ns // INTERVAL_NS for capture in captures] == [0, 2, 2]
    assert captures[2].image is None
    assert sum("an image not later than the previous one" in each for each in faults(captures)) == 2


def test_a_damaged_chunk_ends_the_bag_with_a_fault(tmp_path):
    noise = list(np.random.default_rng(2).integers(0, 9, (60, 160, 160, 3), np.uint8))
    bag = images_bag(tmp_path / "bag", noise, compression="storage")
    (file,) = bag.glob("*.mcap")
    data = bytearray(file.read_bytes())
    middle = int(0.7 * len(data))
    data[middle : middle + 1000] = bytes(1000)
    file.write_bytes(data)
    captures = drain(open_bag(bag))
    assert 5 < len(captures) < 60
    assert all(capture.image is not None for capture in captures[:-1])
    (fault,) = captures[-1].faults
    assert f"cannot be read beyond message {len(captures) - 2} (" in fault.message


@pytest.mark.parametrize("storage", ["mcap", "db3"])
@pytest.mark.parametrize("keep", [0, 0.5, 0.97])
def test_a_truncated_file_is_refused_or_reported(tmp_path, storage, keep):
    bag = write_bag(tmp_path / "bag", {"/camera": jpegs(IMAGES * 20)}, storage=storage)
    (file,) = bag.glob(f"*.{storage}")
    data = file.read_bytes()
    file.write_bytes(data[: int(keep * len(data))])
    try:
        captures = drain(open_bag(file))
    except BadInput as error:
        assert str(error).startswith(str(file))
    else:
        assert captures[-1].faults


def test_a_folder_and_a_file_that_are_no_bags_are_refused(tmp_path):
    with pytest.raises(
        BadInput, match="no such file or folder; expected rosbag:PATH or 'rosbag:PATH\\?topic=TOPIC'"
    ):
        open_bag(tmp_path / "none.mcap")
    with pytest.raises(BadInput, match=r"a bag's folder has metadata\.yaml"):
        open_bag(tmp_path)
    (tmp_path / "text.mcap").write_text("text")
    with pytest.raises(BadInput, match="not a ROS 2 bag that rosbags can read"):
        open_bag(tmp_path / "text.mcap")
    (tmp_path / "metadata.yaml").write_text("rosbag2_bagfile_information: 3")
    with pytest.raises(BadInput, match="not a ROS 2 bag that rosbags can read"):
        open_bag(tmp_path)


def test_without_rosbags_the_extra_is_named(tmp_path, monkeypatch):
    bag = images_bag(tmp_path / "bag", IMAGES)
    monkeypatch.setitem(sys.modules, "rosbags", None)
    for name in [name for name in sys.modules if name.startswith("rosbags.")]:
        monkeypatch.delitem(sys.modules, name)
    with pytest.raises(MissingExtra, match="rosbag"):
        open_bag(bag)


def test_a_bag_without_definitions_is_read_by_the_names_of_its_types(tmp_path):
    bag = write_bag(tmp_path / "bag", {"/camera": jpegs(IMAGES)}, storage="db3")
    (file,) = bag.glob("*.db3")
    with sqlite3.connect(file) as database:  # as ROS before Iron
        database.execute("DROP TABLE message_definitions")
        database.execute("UPDATE schema SET schema_version = 3")
    assert len(drain(open_bag(bag))) == len(IMAGES)
    assert "sensor_msgs/msg/CompressedImage" in STORE.types


def test_a_folder_of_a_bag_needs_no_prefix(tmp_path, registration_toml):
    eye = tmp_path / "eye.toml"
    eye.write_text(registration_toml)
    images = [np.zeros((240, 320, 3), np.uint8)] * 3
    bag = images_bag(tmp_path / "bag", images)
    result = call("run", bag, "--registration", eye, "--fast")
    assert result.exit_code == 0, result.stderr
    shutil.rmtree(bag)
    assert "no such file or folder" in refuse("run", f"rosbag:{bag}", "--registration", eye, "--fast")
