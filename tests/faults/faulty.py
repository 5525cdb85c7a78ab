"""`haptigraph` with faults that tests inject on demand.

Each line of standard input is the name of a fault that begins now and ends the previous one; "none" only ends it.
The time is reported on standard error. camera:0 shows the scenario that is the first argument. SDL simulates the
game controller; the simulated sound card requests a buffer every 10 ms. Both log their output to the file that the
environment names. Everything else is the real program.
"""

import ctypes
import os
import sys
import threading
import time
from itertools import chain, cycle
from types import SimpleNamespace

import numpy as np

from haptigraph import assemble
from haptigraph.cli import main
from haptigraph.errors import EndOfSource
from haptigraph.perception.needle.tracker import Tracker
from haptigraph.recording.writer import RunWriter
from haptigraph.sources.cameras.uvc import CameraSource
from haptigraph.sources.phantom import PhantomSource

RENDERED, REPEATED = 36, 8  # number of rendered images, and of the last ones that repeat
BUFFER = 480
HOUR_S = 3600

fault = "none"
failures = 0


def set_back(now, by):
    """Return a wall clock that is set back while the fault lasts."""
    return lambda: now() - (by if fault == "wall clock jumps" else 0)


def read_faults():
    """Begin and end faults on request."""
    global fault, failures
    for line in sys.stdin:
        failures, fault = 0, line.strip()
        print(f"fault {fault} begins {time.monotonic_ns()}", file=sys.stderr, flush=True)


class Driver:
    """The interface of OpenCV to a camera driver."""

    def __init__(self, scenario):
        source, images = PhantomSource(scenario), []
        while len(images) < RENDERED:
            images.append(source.read(1.0).image)
        self.images = chain(images, cycle(images[-REPEATED:]))
        self.due_s = time.monotonic()

    def __call__(self, number):
        return self

    def isOpened(self):
        return fault != "lost camera"

    def set(self, *_):
        return True

    def get(self, *_):
        return 0.0

    def release(self):
        pass

    def getBackendName(self):
        return ""

    def grab(self):
        self.due_s = max(self.due_s + 1 / 30, time.monotonic())
        time.sleep(max(self.due_s - time.monotonic(), 0))
        while fault == "stale image":
            time.sleep(0.01)
        return fault != "lost camera"

    def retrieve(self):
        return True, next(self.images)


class FaultyCamera(CameraSource):
    def __init__(self, number, **options):
        super().__init__(number, open_camera=Driver(SCENARIO), **options)

    def read(self, timeout_s):
        if fault == "source ends":
            raise EndOfSource
        return super().read(timeout_s)


class FaultyTracker(Tracker):
    def __call__(self, capture):
        global failures
        if fault == "perceiver stalls":
            threading.Event().wait()
        if fault == "interpreter stalls":  # no Python thread runs, because the GIL is not released
            ctypes.PyDLL(None).usleep(1_000_000)
        if (fault, failures) in {
            ("perceiver fails twice", 0),
            ("perceiver fails twice", 1),
        } or fault == "perceiver fails":
            failures += 1
            raise ValueError("injected")
        return super().__call__(capture)


class PortAudio(threading.Thread):
    """Request buffers in real time, like a sound card, and log the maximum of each."""

    PortAudioError = OSError

    def OutputStream(self, *, callback, **_):
        threading.Thread.__init__(self, daemon=True)
        self.callback, self.active = callback, True
        return SimpleNamespace(start=self.start, close=self.close, active=True)

    def close(self):
        self.active = False
        self.join()

    def run(self):
        out = open(os.environ["HAPTIGRAPH_TEST_OUTPUT"], "a", buffering=1)  # noqa: SIM115
        while self.active:
            samples = np.zeros((BUFFER, 2), np.float32)
            self.callback(samples, BUFFER, None, None)
            print(time.monotonic_ns(), float(np.abs(samples).max().round(1)), file=out)
            time.sleep(BUFFER / 48_000)


def slow_disk(write):
    def slow(self, *arguments, **options):
        if fault == "slow disk":
            time.sleep(1.0)  # much longer than the dead-man timer
        write(self, *arguments, **options)

    return slow


if __name__ == "__main__":
    SCENARIO = sys.argv.pop(1)
    assemble.SOURCES["camera"] = "__main__:FaultyCamera"
    assemble.PERCEIVERS["tracker"] = "__main__:FaultyTracker"
    assemble.DEVICES["gamepad"] = "virtual_pad:VirtualGamepad"
    sys.modules["sounddevice"] = PortAudio.__new__(PortAudio)
    RunWriter.write = slow_disk(RunWriter.write)
    time.time, time.time_ns = set_back(time.time, HOUR_S), set_back(time.time_ns, HOUR_S * 10**9)
    threading.Thread(target=read_faults, daemon=True).start()
    main()
