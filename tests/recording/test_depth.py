"""Depth in recordings: kept bit for bit, replayed identically, and checked by a recovery."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec import UNSET
from paths import DATA

from haptigraph.analysis.metrics.replay import replay
from haptigraph.assemble import build
from haptigraph.config import load_config
from haptigraph.recording.codec import decode_depth, encode_depth, encode_png
from haptigraph.recording.reader import RunReader
from haptigraph.recording.schema import CaptureRecord
from haptigraph.sources.recording import RecordingSource


@pytest.fixture(scope="module")
def deep_run(tmp_path_factory):
    """A recording with depth."""
    path = tmp_path_factory.mktemp("deep") / "deep.mcap"
    settings = f"source.uri=phantom:{DATA / 'deep.toml'}", f"recording.path={path}", "run.realtime=false"
    build(load_config(None, (*settings, f"haptics.device=trace:{path.with_suffix('.csv')}"))).run()
    return path


def test_a_recorded_run_replays_identically_with_its_depth(deep_run):
    report = replay(deep_run)
    assert report.identical == report.steps > 0
    captures = [
        (capture, step) for capture, step in RunReader(deep_run).records() if capture.image is not None
    ]
    assert all(capture.depth is not None for capture, _ in captures)
    assert "needle_3d" in captures[-1][1].observation.found


def test_a_recording_names_the_depth_camera_so_that_it_can_be_registered(deep_run):
    source = RecordingSource(deep_run)
    assert source.depth_camera.focal_px == pytest.approx(674.3, abs=0.1)
    assert source.read(1.0).depth.unit_mm == 0.1
    source.close()


@given(st.integers(1, 30), st.integers(1, 30), st.integers(0, 2**16))
def test_depths_are_stored_losslessly(width, height, seed):
    values = np.random.default_rng(seed).integers(0, 2**16, (height, width)).astype(np.uint16)
    assert (decode_depth(encode_depth(values)) == values).all()


@pytest.mark.parametrize("data", [b"", b"no image", encode_png(np.zeros((4, 4), np.uint8))])
def test_what_is_no_depth_is_refused(data):
    with pytest.raises(ValueError, match=r"not depths of 16 bits"):
        decode_depth(data)


def test_captures_without_depth_are_recorded_as_before():
    assert CaptureRecord(0, 0, "none").depth is UNSET
