"""A real run whose camera goes away: the hand is still in time, and feels again when the camera is back.

The device is a trace file, read as it grows: what stands there has left the guard.
"""

import csv
import os
import queue
import signal
import subprocess
import sys
import threading
import time
from itertools import groupby
from pathlib import Path

import cv2
import pytest
from rig import Beat
from streaming import StreamingCamera

from haptigraph.clock import VirtualClock
from haptigraph.recording.codec import encode_jpeg, encode_png
from haptigraph.recording.reader import RunReader
from haptigraph.sources.teleop import TeleopSource

pytestmark = pytest.mark.xdist_group("faults")

HERE = Path(__file__).parent
PATIENCE_S = 30.0
LOOK_S = 0.002
STALE_MS, DEADMAN_MS = 100, 150


class Run:
    """A process that runs the loop on a source, with a trace for a hand."""

    def __init__(self, folder, program, uri, eye, *options):
        self.trace, self.recording = folder / "touch.csv", folder / "run.mcap"
        command = [*program, "run", uri, "--registration", eye, "--device", f"trace:{self.trace}"]
        path = os.pathsep.join(
            [str(HERE.parent / "support"), *os.environ.get("PYTHONPATH", "").split(os.pathsep)]
        )
        self.process = subprocess.Popen(
            [sys.executable, *map(str, command), "--record", str(self.recording), *options],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            env={**os.environ, "PYTHONPATH": path.strip(os.pathsep)},
        )
        self.lines: queue.Queue[str] = queue.Queue()
        self.told: list[str] = []
        self.listener = threading.Thread(target=self.listen)
        self.listener.start()

    def listen(self):
        for line in self.process.stderr:
            self.lines.put(line)

    def hears(self, text):
        """Wait until the run tells something."""
        while True:
            self.told.append(self.lines.get(timeout=PATIENCE_S))
            if text in self.told[-1]:
                return

    def feels(self, vibrating):
        """Wait until the hand vibrates, or is still; return when [ns]."""
        end_s = time.monotonic() + PATIENCE_S
        while time.monotonic() < end_s:
            now_ns = time.monotonic_ns()
            if self.trace.exists():
                rows = self.trace.read_text().splitlines()[1:]
                if rows and (float(rows[-1].split(",")[1]) > 0) is vibrating:
                    return now_ns
            time.sleep(LOOK_S)
        raise AssertionError(f"never; told: {self.told}")

    def end(self):
        self.process.send_signal(signal.SIGINT)
        out, _ = self.process.communicate(timeout=PATIENCE_S)
        self.listener.join()
        self.told += list(self.lines.queue)
        return out

    def stop(self):
        self.process.kill()
        self.process.communicate()
        self.listener.join()


@pytest.fixture
def eye(quick, tmp_path):
    """An image in which the hand is to vibrate, and the path of its registration."""
    source = TeleopSource(quick.replace("quick.toml", "steered.toml"), VirtualClock())
    file = tmp_path / "eye.toml"
    file.write_text(source.registration)
    return source.read(1.0).image, file


@pytest.fixture(params=["unplugged", "hangs", "realsense"])
def running(request, eye, tmp_path):
    """A run, how its camera goes away, and how it comes back."""
    image, registration = eye
    module = ["-m", "haptigraph"]
    if request.param == "realsense":
        pytest.importorskip("pyrealsense2", exc_type=ImportError)
        (tmp_path / "image.png").write_bytes(encode_png(image))
        program = [HERE / "realsense_run.py", tmp_path / "image.png"]
        run = Run(tmp_path, program, "realsense", registration)

        def say(word):
            run.process.stdin.write(f"{word}\n")
            run.process.stdin.flush()

        yield run, lambda: say("silent"), lambda: say("speak")
        run.stop()
        return
    camera = StreamingCamera([encode_jpeg(image, 95)])
    run = Run(tmp_path, module, camera.uri, registration)
    go, come = (
        (camera.unplug, camera.plug_in) if request.param == "unplugged" else (camera.hang, camera.go_on)
    )
    yield run, go, come
    run.stop()
    camera.unplug()


def test_a_hand_whose_camera_goes_away_is_still_in_time_and_feels_again_when_it_is_back(
    running, record_property
):
    run, go, come = running
    run.feels(vibrating=True)
    beat = Beat()
    gone_ns = time.monotonic_ns()
    go()
    silent_ns = run.feels(vibrating=False)
    beat.over.set()
    silent_ms = (silent_ns - gone_ns) / 1e6
    record_property("silent_ms", round(silent_ms))
    assert silent_ms <= STALE_MS + DEADMAN_MS + beat.late_ms(gone_ns, silent_ns)
    run.hears("delivers no images; trying to get it back")
    assert run.process.poll() is None
    come()
    run.feels(vibrating=True)
    out = run.end()
    assert run.process.returncode == 0
    assert "interrupted" in out
    assert "delivers no images" in "".join(run.told)
    with run.trace.open() as file:
        assert float(list(csv.DictReader(file))[-1]["amplitude"]) == 0
    reader = RunReader(run.recording)
    assert reader.is_whole
    states = [
        (step.conclusion.state != "unknown", bool(step.faults)) for _, step in reader.records(images=())
    ]
    assert not any(is_known for is_known, is_fault in states if is_fault)
    assert [is_known for is_known, _ in groupby(is_known for is_known, _ in states)][-3:] == [
        True,
        False,
        True,
    ]


def test_a_hand_is_still_when_a_video_ends(eye, tmp_path):
    image, registration = eye
    writer = cv2.VideoWriter(
        str(tmp_path / "v.avi"), cv2.VideoWriter.fourcc(*"MJPG"), 30.0, image.shape[1::-1]
    )
    for _ in range(30):
        writer.write(image)
    writer.release()
    run = Run(tmp_path, ["-m", "haptigraph"], tmp_path / "v.avi", registration, "--realtime")
    beat = Beat()
    try:
        run.feels(vibrating=True)
        out, _ = run.process.communicate(timeout=PATIENCE_S)
        run.listener.join()
    finally:
        run.stop()
        beat.over.set()
    assert run.process.returncode == 0
    assert "source ended" in out
    with run.trace.open() as file:
        rows = [(int(row["stamp_ns"]), float(row["amplitude"])) for row in csv.DictReader(file)]
    steps = [step for _, step in RunReader(run.recording).records(images=())]
    assert rows[-1][1] == 0
    assert steps[-1].conclusion.state == "unknown"
    last_ns, still_ns = steps[-2].timing.commanded_ns, rows[-1][0]
    assert (still_ns - last_ns) / 1e6 <= DEADMAN_MS + beat.late_ms(last_ns, still_ns + Beat.PERIOD_S * 1e9)
