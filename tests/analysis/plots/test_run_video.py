import sys

import cv2
import numpy as np
import pytest
from evidence_files import record
from helpers import call, refuse
from matplotlib.colors import to_rgb
from msgspec.structs import replace

from haptigraph.analysis.plots import video_file
from haptigraph.analysis.plots.run_video import HEADER_PX, HEIGHT_PX, NO_IMAGE, STRIP, WIDTH_PX, run_video
from haptigraph.analysis.plots.series import read_series
from haptigraph.errors import BadInput
from haptigraph.recording.reader import RunReader
from haptigraph.recording.writer import RunWriter
from haptigraph.registration.loading import parse_registration

av = pytest.importorskip("av")
TOLERANCE = 12  # grey values, after lossy compression


def shortened(whole, path, numbers, without_image=None):
    """Some steps of a recording, one of them without its image."""
    reader = RunReader(whole)
    image = parse_registration(reader.info.registration, "registration").image
    writer = RunWriter(path, reader.info, image, ())
    for number, (capture, step) in enumerate(reader.records()):
        if number in numbers:
            empty = replace(capture, image=None, encoded=None)
            writer.write(empty if number == without_image else capture, step)
    writer.close()
    return path


@pytest.fixture(scope="module")
def run(quick_uri, tmp_path_factory):
    """A quarter of the short scenario's steps; the tenth has no image."""
    folder = tmp_path_factory.mktemp("video")
    whole = record(quick_uri, folder / "whole.mcap")
    return shortened(whole, folder / "run.mcap", range(0, 1000, 4), without_image=40)


@pytest.fixture(scope="module")
def pictures(run, tmp_path_factory):
    """Every picture of its video, RGB, with its time [s]."""
    path = tmp_path_factory.mktemp("video") / "run.mp4"
    assert run_video(run, path) == "H.264"
    with av.open(str(path)) as container:
        stream = container.streams.video[0]
        assert (stream.codec_context.name, stream.codec_context.pix_fmt) == ("h264", "yuv420p")
        assert not {"comment", "title", "creation_time"} & set(container.metadata)
        return [(float(frame.time), frame.to_ndarray(format="rgb24")) for frame in container.decode(stream)]


def test_every_step_is_a_picture_at_its_time(run, pictures):
    series = read_series(RunReader(run))
    assert [time_s for time_s, _ in pictures] == pytest.approx(series.time_s, abs=0.002)
    assert {picture.shape for _, picture in pictures} == {(HEIGHT_PX, WIDTH_PX, 3)}


def test_the_header_has_the_colour_of_the_state(run, pictures):
    series = read_series(RunReader(run))
    assert len({step.conclusion.state for step in series.steps}) > 3
    for (_, picture), step in zip(pictures, series.steps, strict=True):
        color = 255 * np.array(to_rgb(series.color(step.conclusion.state)))
        assert np.abs(picture[4, WIDTH_PX // 2] - color).max() < TOLERANCE


def test_the_strip_shows_the_commanded_amplitude_at_the_cursor(run, pictures):
    series = read_series(RunReader(run))
    fine_s, amplitude = map(np.array, series.amplitudes())
    left, top, width, height = STRIP
    checked = 0
    for time_s, picture in pictures:
        near = amplitude[np.abs(fine_s - time_s) < 0.1]
        if np.ptp(near) == 0:
            column = picture[top : top + height, left + width // 2 + 4].astype(int)
            purple = (column[:, 0] - column[:, 1] > 50) & (column[:, 2] - column[:, 1] > 25)
            assert purple.mean() == pytest.approx(near[0] / 1.05, abs=0.05)
            checked += near[0] > 0
    assert checked > 3


def test_a_step_without_an_image_shows_none(pictures):
    _, picture = pictures[10]
    view = picture[HEADER_PX : HEADER_PX + WIDTH_PX]
    assert np.abs(view[5, 5].astype(int) - NO_IMAGE).max() < TOLERANCE
    assert np.abs(pictures[9][1][HEADER_PX + 5, 5].astype(int)).max() < TOLERANCE  # black outside the globe


def test_the_needle_and_the_anatomy_are_drawn(pictures):
    hsv = cv2.cvtColor(pictures[-3][1][HEADER_PX : HEADER_PX + WIDTH_PX - 150], cv2.COLOR_RGB2HSV)
    yellow = cv2.inRange(hsv, (18, 120, 120), (32, 255, 255)).sum() / 255
    assert yellow > 200


def test_without_h264_the_codec_is_named(run, tmp_path, monkeypatch):
    monkeypatch.setattr(video_file, "CODECS", {"none": "H.264", "libvpx-vp9": "VP9"})
    run = shortened(run, tmp_path / "short.mcap", range(3))
    output = call("study", "video", run, "-o", tmp_path / "run.mp4").stdout
    assert (
        output
        == f"{tmp_path / 'run.mp4'}  VP9: this PyAV has no encoder for H.264, and not every browser plays it\n"
    )
    monkeypatch.setattr(video_file, "CODECS", {"none": "H.264"})
    with pytest.raises(BadInput, match="cannot be encoded: this PyAV has none of none"):
        run_video(run, tmp_path / "other.mp4")
    assert {path.name for path in tmp_path.iterdir()} == {"run.mp4", "short.mcap"}


def test_what_cannot_be_drawn_is_refused(run, tmp_path, monkeypatch):
    recordings = tmp_path / "recordings"
    recordings.mkdir()
    new = tmp_path / "new.mp4"
    assert "recordings has no recordings" in refuse("study", "video", recordings / "a.mcap", "-o", new)
    (recordings / "trial-1-1-1-attempt1.mcap").write_bytes(b"")
    for wrong, problem in ((recordings / "trial-9.mcap", "does not exist"), (recordings, "is a folder")):
        message = refuse("study", "video", wrong, "-o", new)
        assert f"{problem}; give a recording: {recordings} has trial-1-1-1-attempt1.mcap" in message
    assert "not a recording" in refuse("study", "video", recordings / "trial-1-1-1-attempt1.mcap", "-o", new)
    assert "its name ends in .mp4" in refuse("study", "video", run, "-o", tmp_path / "new.avi")
    new.touch()
    assert "exists already; delete it or give another name" in refuse("study", "video", run, "-o", new)
    assert "cannot be written (No such file" in refuse(
        "study", "video", run, "-o", tmp_path / "no" / "new.mp4"
    )
    monkeypatch.setitem(sys.modules, "av", None)
    extra = refuse("study", "video", run, "-o", tmp_path / "more.mp4")
    assert "a video needs an extra; install it with: pip install 'haptigraph[video]'" in extra
