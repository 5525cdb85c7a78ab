"""OpenCV reads time stamps and rotation of video containers, so no other library is needed (decision 0011)."""

import struct
from fractions import Fraction

import av
import numpy as np
import pytest
from helpers import drain

from haptigraph.sources.video import VideoSource

VARYING_MS = (0, 33, 66, 166, 200, 233, 433, 466, 500, 533)
SIZE_PX = 128, 96


def picture(number: int) -> np.ndarray:
    """A dark image whose lower left quarter encodes its number."""
    image = np.full((SIZE_PX[1], SIZE_PX[0], 3), 20, np.uint8)
    image[SIZE_PX[1] // 2 :, : SIZE_PX[0] // 2] = 20 * (number % 12)
    return image


def write(path, codec="libx264", pixels="yuv420p", stamps_ms=VARYING_MS, rate=30, **options):
    """Write images with these time stamps."""
    base = {".ts": Fraction(1, 90_000), ".avi": Fraction(1, rate)}.get(path.suffix, Fraction(1, 1000))
    with av.open(str(path), "w") as container:
        stream = container.add_stream(codec, rate=rate, options={"x265-params": "log-level=none"} | options)
        stream.width, stream.height, stream.pix_fmt = *SIZE_PX, pixels
        stream.time_base = stream.codec_context.time_base = base
        for number, stamp_ms in enumerate(stamps_ms):
            image = av.VideoFrame.from_ndarray(picture(number), format="bgr24").reformat(format=pixels)
            image.pts, image.time_base = round(Fraction(stamp_ms, 1000) / base), base
            container.mux(stream.encode(image))
        container.mux(stream.encode())
    return path


@pytest.mark.parametrize(
    ("name", "codec", "pixels"),
    [
        ("a.mp4", "libx264", "yuv420p"),
        ("a.mkv", "libx264", "yuv420p"),
        ("a.mov", "libx264", "yuv420p"),
        ("a.ts", "libx264", "yuv420p"),
        ("a.webm", "libvpx-vp9", "yuv420p"),
        ("a.mkv", "libsvtav1", "yuv420p"),
        ("ten_bit.mkv", "libx265", "yuv420p10le"),
        ("ten_bit.mp4", "libx264", "yuv420p10le"),
        ("deep.mkv", "ffv1", "gray16le"),
        ("a.mov", "prores_ks", "yuv422p10le"),
    ],
)
def test_images_at_a_variable_rate_have_the_stamps_of_the_container(tmp_path, name, codec, pixels):
    captures = drain(VideoSource(write(tmp_path / name, codec, pixels)))
    assert [round(capture.stamp_ns / 1e6) for capture in captures] == list(VARYING_MS)
    assert [capture.faults for capture in captures] == [()] * len(VARYING_MS)
    for number, capture in enumerate(captures):
        quarter = capture.image[SIZE_PX[1] * 3 // 4, SIZE_PX[0] // 4]
        assert np.abs(quarter.astype(int) - 20 * number).max() <= 8


@pytest.mark.parametrize("name", ["a.mp4", "a.mkv", "a.ts"])
def test_time_starts_at_the_first_image(tmp_path, name):
    late = [5000 + stamp_ms for stamp_ms in VARYING_MS]
    captures = drain(VideoSource(write(tmp_path / name, stamps_ms=late)))
    assert [round(capture.stamp_ns / 1e6) for capture in captures] == list(VARYING_MS)


def test_b_frames_come_in_display_order(tmp_path):
    captures = drain(VideoSource(write(tmp_path / "b.mp4", bf="2", g="30")))
    assert [round(capture.stamp_ns / 1e6) for capture in captures] == list(VARYING_MS)


@pytest.mark.parametrize("name", ["a.mp4", "a.mkv", "a.ts"])
def test_an_image_shown_for_long_is_not_a_truncation(tmp_path, name):
    captures = drain(VideoSource(write(tmp_path / name, stamps_ms=[0, 33, 66, 2000, 2033, 2066, 4000, 4033])))
    assert len(captures) == 8
    assert not any(capture.faults for capture in captures)


@pytest.mark.parametrize(
    ("name", "codec", "pixels", "begin_ms"),
    [
        ("a.mkv", "ffv1", "bgr0", 0),
        ("a.mkv", "ffv1", "bgr0", 5000),
        ("a.webm", "libvpx-vp9", "yuv420p", 5000),
        ("a.avi", "mjpeg", "yuvj420p", 0),
    ],
)
def test_a_truncated_file_is_reported(tmp_path, name, codec, pixels, begin_ms):
    steady = [begin_ms + 40 * number for number in range(50)]
    path = write(tmp_path / name, codec, pixels, steady, rate=25)
    assert not drain(VideoSource(path))[-1].faults
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    captures = drain(VideoSource(path))
    assert 1 < len(captures) < 45
    assert captures[-1].image is None
    assert f"is truncated after {len(captures) - 1} of" in captures[-1].faults[0].message


def test_images_are_rotated_as_the_container_states(tmp_path):
    path = write(tmp_path / "phone.mp4")
    upright = struct.pack(">9i", 0x10000, 0, 0, 0, 0x10000, 0, 0, 0, 0x40000000)
    rotated = struct.pack(">9i", 0, 0x10000, 0, -0x10000, 0, 0, SIZE_PX[1] << 16, 0, 0x40000000)
    data = path.read_bytes()
    start = data.index(upright, data.index(b"tkhd"))
    path.write_bytes(data[:start] + rotated + data[start + len(rotated) :])
    image = drain(VideoSource(path))[9].image
    assert image.shape == (SIZE_PX[0], SIZE_PX[1], 3)
    assert image[SIZE_PX[0] // 4, SIZE_PX[1] // 4].mean() > 150  # lower left has become upper left
    assert image[SIZE_PX[0] * 3 // 4, SIZE_PX[1] // 4].mean() < 60


def test_images_without_stamps_come_at_the_rate_of_the_file(tmp_path):
    source = VideoSource(write(tmp_path / "raw.h264"))
    captures = drain(source)
    assert len(captures) == len(VARYING_MS)
    intervals_ns = set(np.diff([capture.stamp_ns for capture in captures]).tolist())
    assert intervals_ns == {round(1e9 / source.rate_hz)}
    assert captures[0].stamp_ns == 0
    assert not any(capture.faults for capture in captures)
