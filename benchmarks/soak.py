"""Hours of operation with random faults, as fast as possible: leaks, stuck actuators, lost records.

Runs and records the whole loop with the simulated operator on a virtual clock, ten minutes per file, with
random gaps and losses of images and failures of perceiver and actuator. After every step without a needle the
actuator must be silent or failing; the recording must contain every step; memory must not grow.

Usage: python benchmarks/soak.py [HOURS]   (8 if not given, an hour takes about 20 minutes on a busy core)
"""

import random
import sys
import tempfile
import time
from contextlib import suppress
from itertools import cycle
from pathlib import Path

from memory import resident_mb

from haptigraph import assemble
from haptigraph.clock import Clock
from haptigraph.config import PerceptionConfig, load_config
from haptigraph.errors import DeviceError, EndOfSource, SourceLost
from haptigraph.messages import UNKNOWN, Capabilities, Capture, Observation
from haptigraph.perception.needle.tracker import Tracker
from haptigraph.recording.codec import decode, encode_jpeg
from haptigraph.recording.reader import RunReader
from haptigraph.registration.camera import Registration
from haptigraph.sources.phantom import PhantomSource
from haptigraph.stages import Source

SCENARIO = str(Path(__file__).parents[1] / "tests" / "data" / "quick.toml")
FILE_S = 600
rng = random.Random(2)


class ShakySource(Source):
    """The looped images of a scenario, with random gaps and losses."""

    is_live = False

    def __init__(self, argument: str, clock: Clock, target_mm: float | None = None) -> None:
        source = PhantomSource(SCENARIO, target_mm=target_mm)
        self.rate_hz, self.registration = source.rate_hz, source.registration
        images = []
        with suppress(EndOfSource):
            while (capture := source.read(1.0)) is not None:
                images.append(encode_jpeg(capture.image, 90))
        self._images = cycle(images)
        self._index, self._missing = -1, 0

    def read(self, timeout_s: float) -> Capture | None:
        """Return the next image, or simulate a fault."""
        if self._index >= FILE_S * self.rate_hz:
            raise EndOfSource
        self._index += 1
        encoded = next(self._images)
        if self._missing or rng.random() < 0.002:
            self._missing = (self._missing or rng.randrange(2, 30)) - 1
            if self._missing % 2:
                raise SourceLost("camera:0 delivers no images")
            return None
        return Capture(self._index, round(self._index * 1e9 / self.rate_hz), decode(encoded), encoded)

    def close(self) -> None:
        """Do nothing."""


class ShakyTracker(Tracker):
    """The tracker with random errors, at most two in a row."""

    def __init__(self, registration: Registration, config: PerceptionConfig) -> None:
        super().__init__(registration, config)
        self._failed = 0

    def __call__(self, capture: Capture) -> Observation:
        """Process one image, or raise."""
        if self._failed < 2 and rng.random() < (0.5 if self._failed else 0.002):
            self._failed += 1
            raise ValueError("injected")
        self._failed = 0
        return super().__call__(capture)


class ShakyDevice:
    """An actuator with random failures of up to a hundred commands."""

    capabilities = Capabilities(100, None, 50.0, max_rate_hz=20.0, holds_ms=150.0)
    newest: "ShakyDevice"

    def __init__(self, argument: str) -> None:
        ShakyDevice.newest = self
        self.amplitude, self.failing, self.failed = 0.0, 0, False

    def set(self, amplitude: float, frequency_hz: float, stamp_ns: int) -> None:
        """Set the amplitude, or fail."""
        if self.failing or rng.random() < 0.001:
            self.failing = (self.failing or rng.randrange(2, 100)) - 1
            self.failed = True
            raise DeviceError("injected")
        self.amplitude, self.failed = amplitude, False

    def close(self) -> None:
        """Stop the vibration."""
        self.amplitude = 0.0


def run_file(path: Path) -> tuple[int, int, int, int]:
    """Run ten minutes; return the numbers of steps, faults, steps with a stuck actuator, and lost records."""
    settings = (
        "source.uri=teleop:soak",
        "run.realtime=false",
        "source.jpeg_quality=0",
        f"recording.path={path}",
    )
    loop = assemble.build(load_config(None, settings))
    steps = faults = stuck = 0
    for step in loop.steps():
        steps += 1
        faults += len(step.faults)
        device = ShakyDevice.newest
        stuck += step.conclusion.state == UNKNOWN and device.amplitude > 0 and not device.failed
    stuck += ShakyDevice.newest.amplitude > 0
    found, _ = RunReader(path).count()
    path.unlink()
    return steps, faults, stuck, steps - found + loop.report.dropped


def main() -> None:
    """Run, and print a line per file."""
    hours = float(sys.argv[1]) if len(sys.argv) > 1 else 8.0
    assemble.SOURCES["teleop"] = "__main__:ShakySource"
    assemble.PERCEIVERS["tracker"] = "__main__:ShakyTracker"
    assemble.DEVICES["console"] = "__main__:ShakyDevice"
    total, start_s = [0, 0, 0, 0], time.perf_counter()
    with tempfile.TemporaryDirectory() as folder:
        for number in range(1, round(hours * 3600 / FILE_S) + 1):
            counts = run_file(Path(folder) / f"{number}.mcap")
            total = [sum(pair) for pair in zip(total, counts, strict=True)]
            steps, faults, stuck, lost = total
            rate_hz = steps / (time.perf_counter() - start_s)
            print(
                f"{number * FILE_S / 3600:5.2f} h  {steps:7d} steps  {faults:6d} faults  {stuck} stuck  "
                f"{lost} lost  {resident_mb():7.1f} MB  {rate_hz:5.1f} steps/s",
                flush=True,
            )


if __name__ == "__main__":
    main()
