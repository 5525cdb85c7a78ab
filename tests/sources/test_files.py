import cv2
import numpy as np
import pytest
from helpers import drain

from haptigraph.errors import BadInput, EndOfSource
from haptigraph.messages import Capture
from haptigraph.recording.codec import encode_jpeg, encode_png
from haptigraph.sources.images import ImagesSource
from haptigraph.sources.jpeg import JpegSource
from haptigraph.sources.video import VideoSource
from haptigraph.stages import Source


def picture(number: int) -> np.ndarray:
    return np.full((48, 64, 3), 10 * number, np.uint8)


@pytest.fixture
def video(tmp_path):
    path = tmp_path / "v.avi"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), 25.0, (64, 48))
    for number in range(12):
        writer.write(picture(number))
    writer.release()
    return path


def test_a_video_is_read_with_its_own_time_stamps(video):
    source = VideoSource(video)
    assert source.rate_hz == 25.0
    captures = drain(source)
    assert [capture.index for capture in captures] == list(range(12))
    assert [capture.stamp_ns for capture in captures] == pytest.approx([n * 4e7 for n in range(12)], abs=1e6)
    assert abs(int(captures[7].image[20, 20, 0]) - 70) < 3
    with pytest.raises(EndOfSource):
        source.read(1.0)


def test_a_truncated_video_is_reported(video):
    data = video.read_bytes()
    whole = len(drain(VideoSource(video)))
    short = video.with_name("short.avi")
    short.write_bytes(data[: (data.find(b"movi") + data.find(b"idx1")) // 2])
    captures = drain(VideoSource(short))
    images = [capture for capture in captures if capture.image is not None]
    assert 0 < len(images) < whole
    assert "is truncated after" in captures[-1].faults[0].message


@pytest.mark.parametrize(
    ("content", "problem"), [(None, "no such file"), (b"hello" * 99, "not a video that OpenCV")]
)
def test_an_unreadable_video_is_rejected(tmp_path, content, problem):
    path = tmp_path / "v.mp4"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(BadInput, match=problem):
        VideoSource(path)


def test_images_of_a_folder_come_in_natural_order(tmp_path):
    for number in (10, 2, 1):
        (tmp_path / f"image{number}.png").write_bytes(encode_png(picture(number)))
    (tmp_path / "notes.txt").write_text("not an image")
    captures = drain(ImagesSource(tmp_path, rate_hz=10))
    assert [int(capture.image[0, 0, 0]) for capture in captures] == [10, 20, 100]
    assert [capture.stamp_ns for capture in captures] == [0, 100_000_000, 200_000_000]


def test_jpeg_and_png_files_keep_their_bytes(tmp_path):
    jpeg = encode_jpeg(picture(3), 90)
    (tmp_path / "1.jpg").write_bytes(jpeg)
    cv2.imwrite(str(tmp_path / "2.bmp"), picture(4))
    first, second = drain(ImagesSource(tmp_path, rate_hz=30))
    assert first.encoded == jpeg
    assert second.encoded is None
    assert np.array_equal(second.image, picture(4))


def test_an_empty_folder_and_a_broken_image_are_rejected(tmp_path):
    with pytest.raises(BadInput, match=r"no images in the folder; supported are \.png"):
        ImagesSource(tmp_path, rate_hz=30)
    (tmp_path / "1.png").write_bytes(b"broken")
    with pytest.raises(BadInput, match=r"1\.png: not an image that OpenCV can read"):
        ImagesSource(tmp_path, rate_hz=30).read(1.0)


class OneCapture(Source):
    rate_hz, is_live = 30.0, False

    def __init__(self, capture):
        self.capture = capture

    def read(self, timeout_s):
        return self.capture

    def close(self):
        pass


def test_perception_processes_the_compressed_image():
    image = np.random.default_rng(0).integers(0, 255, (48, 64, 3)).astype(np.uint8)
    capture = JpegSource(OneCapture(Capture(0, 0, image)), quality=80).read(1.0)
    assert not np.array_equal(capture.image, image)
    assert np.array_equal(
        capture.image, cv2.imdecode(np.frombuffer(capture.encoded, np.uint8), cv2.IMREAD_COLOR)
    )


@pytest.mark.parametrize("capture", [None, Capture(0, 0, None), Capture(0, 0, picture(1), b"bytes")])
def test_captures_already_encoded_or_without_image_pass_unchanged(capture):
    assert JpegSource(OneCapture(capture), quality=80).read(1.0) is capture


def test_digits_that_are_not_decimal_do_not_break_the_order(tmp_path):
    for name in ("a²10.png", "a²9.png", "a2²1.png"):
        (tmp_path / name).write_bytes(encode_png(np.zeros((4, 4), np.uint8)))
    source = ImagesSource(tmp_path, 10.0)
    assert [file.name for file in source._files] == ["a2²1.png", "a²9.png", "a²10.png"]
