"""Every source keeps the Source contract. A new source joins by getting an opener here."""

import cv2
import numpy as np
import pytest

from haptigraph import assemble
from haptigraph.clock import VirtualClock
from haptigraph.config import load_config
from haptigraph.errors import EndOfSource
from haptigraph.messages import Capture
from haptigraph.recording.codec import encode_png
from haptigraph.stages import Source

FILES = ["images", "phantom", "recording", "video"]


@pytest.fixture
def uri(request, tmp_path, quick_uri):
    kind = request.param
    if kind == "images":
        for number in range(5):
            (tmp_path / f"{number}.png").write_bytes(encode_png(np.full((20, 20, 3), number, np.uint8)))
        return str(tmp_path)
    if kind == "phantom":
        return quick_uri
    if kind == "recording":
        path = tmp_path / "r.mcap"
        settings = (f"source.uri={quick_uri}", "run.realtime=false", f'recording.path="{path}"')
        assemble.build(load_config(None, settings)).run()
        return str(path)
    path = tmp_path / "v.avi"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), 30.0, (32, 24))
    for number in range(5):
        writer.write(np.full((24, 32, 3), number, np.uint8))
    writer.release()
    return str(path)


def open_uri(uri):
    return assemble.open_source(load_config(None, (f'source.uri="{uri}"',)), VirtualClock())


def drain(source):
    captures = []
    try:
        while len(captures) < 1000:
            capture = source.read(1.0)
            if capture is not None:
                captures.append(capture)
    except EndOfSource:
        return captures
    raise AssertionError("it never ends")


def test_all_sources_are_under_contract():
    assert {*FILES, "camera", "teleop"} == set(assemble.SOURCES)  # these two have tests of their own


@pytest.mark.parametrize("uri", FILES, indirect=True)
def test_a_source_delivers_ordered_captures_and_then_ends_for_good(uri):
    source = open_uri(uri)
    assert isinstance(source, Source)
    assert source.rate_hz > 0
    assert source.is_live is False
    captures = drain(source)
    assert len(captures) >= 5
    indices = [capture.index for capture in captures]
    stamps = [capture.stamp_ns for capture in captures]
    assert indices == sorted(indices)
    assert stamps == sorted(stamps)
    assert stamps[0] == 0
    assert all(isinstance(capture, Capture) for capture in captures)
    assert all(capture.image.dtype == np.uint8 for capture in captures if capture.image is not None)
    with pytest.raises(EndOfSource):
        source.read(1.0)
    source.close()
    source.close()


@pytest.mark.parametrize("uri", FILES, indirect=True)
def test_opening_again_gives_the_same_images(uri):
    first, second = open_uri(uri), open_uri(uri)
    for one, other in zip(drain(first), drain(second), strict=True):
        assert one.stamp_ns == other.stamp_ns
        assert (one.image is None) == (other.image is None)
        assert one.image is None or np.array_equal(one.image, other.image)
    first.close()
    second.close()
