"""A perceiver, two sources and devices as a user may write them, for tests that name them "own_parts:Class"."""

import numpy as np

from haptigraph.errors import DeviceError, EndOfSource
from haptigraph.messages import Capabilities, Capture
from haptigraph.perception.baseline.threshold import ThresholdPerceiver
from haptigraph.projection import ImageGeometry
from haptigraph.sim.eye.eye import Eye, EyeShape, registration_text
from haptigraph.stages import Source

GEOMETRY = ImageGeometry(center_px=(160.0, 120.0), mm_per_px=1 / 8, mirrored=True)


class Perceiver(ThresholdPerceiver):
    """Like that of the paper."""


class WithoutMembers:
    pass


class FilmSource(Source):
    """As many black images as its argument says."""

    rate_hz, is_live = 30.0, False

    def __init__(self, argument):
        self._left, self.registration = (
            int(argument or 2),
            registration_text(Eye(EyeShape()), GEOMETRY, 320, 240),
        )
        self._read = 0

    def read(self, timeout_s):
        if self._read == self._left:
            raise EndOfSource
        self._read += 1
        return Capture(self._read - 1, self._read * 33_000_000, np.zeros((240, 320, 3), np.uint8))

    def close(self):
        pass


class LiveSource(FilmSource):
    is_live = True

    def __init__(self, argument, clock):
        super().__init__(argument)
        self.clock = clock


class LateSource(FilmSource):
    """Says only as an object that it is live."""

    def __init__(self, argument):
        super().__init__(argument)
        self.is_live = True


class Device:
    """Writes every amplitude to the file that its argument names."""

    capabilities = Capabilities(255, None, 1.0)

    def __init__(self, argument):
        self._file = open(argument, "a", buffering=1)  # noqa: SIM115

    def set(self, amplitude, frequency_hz, stamp_ns):
        self._file.write(f"{amplitude:g}\n")

    def close(self):
        self._file.write("closed\n")


class FlakyDevice:
    """Is unplugged between the two times that its argument names: "3.0-4.0" [s on the run's clock]."""

    capabilities = Capabilities(100, None, 0.0)

    def __init__(self, argument):
        self._from_ns, self._to_ns = (round(1e9 * float(time_s)) for time_s in argument.split("-"))

    def set(self, amplitude, frequency_hz, stamp_ns):
        if self._from_ns <= stamp_ns < self._to_ns:
            raise DeviceError("unplugged")

    def close(self):
        pass


class DeviceWithoutMembers:
    capabilities = Capabilities(255, None, 1.0)

    def __init__(self, argument):
        pass
