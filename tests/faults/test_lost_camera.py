"""A real run that loses its camera: the output is silent in time, and resumes when the camera is back.

The device is a trace file, read while it grows: it contains the output of the guard.
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
from helpers import mostly_slow
from real_run import SHARED_MS, LatencyProbe
from streaming import StreamingCamera

from haptigraph.clock import VirtualClock
from haptigraph.recording.codec import encode_jpeg, encode_png
from haptigraph.recording.reader import RunReader
from haptigraph.sources.teleop import TeleopSource

HERE = Path(__file__).parent
TIMEOUT_S = 30.0
POLL_S = 0.002
STALE_MS, DEADMAN_MS = 100, 150


class Run:
    """A process that runs the loop on a source, with a trace as its device."""

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
        self.output: list[str] = []
        self.reader = threading.Thread(target=self.read)
        self.reader.start()

    def read(self):
        for line in self.process.stderr:
            self.lines.put(line)

    def await_message(self, text):
        """Wait until the run reports something."""
        while True:
            self.output.append(self.lines.get(timeout=TIMEOUT_S))
            if text in self.output[-1]:
                return

    def await_output(self, vibrating):
        """Wait until the device vibrates, or is silent; return when [ns]."""
        end_s = time.monotonic() + TIMEOUT_S
        while time.monotonic() < end_s:
            now_ns = time.monotonic_ns()
            if self.trace.exists():
                rows = self.trace.read_text().splitlines()[1:]
                if rows and (float(rows[-1].split(",")[1]) > 0) is vibrating:
                    return now_ns
            time.sleep(POLL_S)
        raise AssertionError(f"timeout; output: {self.output}")

    def end(self):
        self.process.send_signal(signal.SIGINT)
        out, _ = self.process.communicate(timeout=TIMEOUT_S)
        self.reader.join()
        self.output += list(self.lines.queue)
        return out

    def stop(self):
        self.process.kill()
        self.process.communicate()
        self.reader.join()


@pytest.fixture
def eye(quick, tmp_path):
    """An image that causes vibration, and the path of its registration."""
    source = TeleopSource(quick.replace("quick.toml", "steered.toml"), VirtualClock())
    file = tmp_path / "eye.toml"
    file.write_text(source.registration)
    return source.read(1.0).image, file


@pytest.fixture(params=mostly_slow(["unplugged", "hangs", "realsense"], "unplugged", "hangs"))
def running(request, eye, tmp_path):
    """A run, and functions that disconnect and reconnect its camera."""
    image, registration = eye
    module = ["-m", "haptigraph"]
    if request.param == "realsense":
        pytest.importorskip("pyrealsense2", exc_type=ImportError)
        (tmp_path / "image.png").write_bytes(encode_png(image))
        program = [HERE / "realsense_run.py", tmp_path / "image.png"]
        run = Run(tmp_path, program, "realsense", registration)

        def request(what):
            run.process.stdin.write(f"{what}\n")
            run.process.stdin.flush()

        yield run, lambda: request("stop"), lambda: request("resume")
        run.stop()
        return
    camera = StreamingCamera([encode_jpeg(image, 95)])
    run = Run(tmp_path, module, camera.uri, registration)
    disconnect, reconnect = (
        (camera.unplug, camera.plug_in) if request.param == "unplugged" else (camera.hang, camera.go_on)
    )
    yield run, disconnect, reconnect
    run.stop()
    camera.unplug()


def test_a_lost_camera_silences_the_device_in_time_and_vibration_resumes_when_it_is_back(
    running, record_property
):
    run, disconnect, reconnect = running
    run.await_output(vibrating=True)
    probe = LatencyProbe()
    lost_ns = time.monotonic_ns()
    disconnect()
    silent_ns = run.await_output(vibrating=False)
    probe.is_stopped.set()
    silent_ms = (silent_ns - lost_ns) / 1e6
    record_property("silent_ms", round(silent_ms))
    assert silent_ms <= STALE_MS + DEADMAN_MS + SHARED_MS + probe.late_ms(lost_ns, silent_ns)
    run.await_message("delivers no images; trying to get it back")
    assert run.process.poll() is None
    reconnect()
    run.await_output(vibrating=True)
    out = run.end()
    assert run.process.returncode == 0
    assert "interrupted" in out
    assert "delivers no images" in "".join(run.output)
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


def test_the_end_of_a_video_silences_the_device(eye, tmp_path):
    image, registration = eye
    writer = cv2.VideoWriter(
        str(tmp_path / "v.avi"), cv2.VideoWriter.fourcc(*"MJPG"), 30.0, image.shape[1::-1]
    )
    for _ in range(30):
        writer.write(image)
    writer.release()
    run = Run(tmp_path, ["-m", "haptigraph"], tmp_path / "v.avi", registration, "--realtime")
    probe = LatencyProbe()
    try:
        run.await_output(vibrating=True)
        out, _ = run.process.communicate(timeout=TIMEOUT_S)
        run.reader.join()
    finally:
        run.stop()
        probe.is_stopped.set()
    assert run.process.returncode == 0
    assert "source ended" in out
    with run.trace.open() as file:
        rows = [(int(row["stamp_ns"]), float(row["amplitude"])) for row in csv.DictReader(file)]
    steps = [step for _, step in RunReader(run.recording).records(images=())]
    assert rows[-1][1] == 0
    assert steps[-1].conclusion.state == "unknown"
    last_ns, silent_ns = steps[-2].timing.commanded_ns, rows[-1][0]
    assert (silent_ns - last_ns) / 1e6 <= DEADMAN_MS + SHARED_MS + probe.late_ms(
        last_ns, silent_ns + LatencyProbe.PERIOD_S * 1e9
    )
