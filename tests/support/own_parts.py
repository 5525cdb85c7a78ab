"""A perceiver, two sources and devices as a user may write them, for tests that name them "own_parts:Class"."""

import numpy as np
from msgspec.structs import replace

from haptigraph.errors import DeviceError, EndOfSource
from haptigraph.geometry import Point, Segment
from haptigraph.messages import Capabilities, Capture, Certainty, Observation
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


class Returning:
    """A perceiver that returns what its subclass says."""

    images = "eye"
    entities = frozenset({"needle_tip", "needle_line"})
    entities_with_sd = frozenset({"needle_tip", "needle_line"})

    def __init__(self, registration, config):
        self.registration = registration

    def reset(self):
        pass

    def __call__(self, capture):
        found = dict(self.registration.anatomy) | self.shapes
        return Observation(capture.stamp_ns, found, certainty=self.certainty)

    shapes = {"needle_tip": Point((1.0, 2.0)), "needle_line": Segment((8.0, 9.0), (1.0, 2.0))}  # noqa: RUF012
    certainty = Certainty(1.0, 0.05, 0.5)


class NumpyPerceiver(Returning):
    shapes = {  # noqa: RUF012
        "needle_tip": Point(np.array([1.0, 2.0])),
        "needle_line": Segment(np.array([8, 9]), (np.float32(1.0), np.float64(2.0))),
    }
    certainty = Certainty(np.float64(1.0), np.float64(0.05), np.float32(0.5))


class NonePerceiver(Returning):
    def __call__(self, capture):
        pass


class DictPerceiver(Returning):
    def __call__(self, capture):
        return self.shapes


class NanPerceiver(Returning):
    shapes = {"needle_tip": Point((float("nan"), 2.0))}  # noqa: RUF012


class TuplePerceiver(Returning):
    shapes = {"needle_tip": (1.0, 2.0)}  # noqa: RUF012


class TextPerceiver(Returning):
    certainty = Certainty(1.0, "0.05", 0.5)


class MisspeltPerceiver(Returning):
    shapes = {"needle_lin": Segment((8.0, 9.0), (1.0, 2.0))}  # noqa: RUF012


class MisspeltSdPerceiver(Returning):
    entities_with_sd = frozenset({"needle_tip_sd"})


class RaisingPerceiver(Returning):
    def __call__(self, capture):
        return np.linalg.inv(np.zeros((2, 2)))  # raised in NumPy


class NumpySource(FilmSource):
    def read(self, timeout_s):
        capture = super().read(timeout_s)
        return replace(capture, index=np.int64(capture.index), stamp_ns=np.int64(capture.stamp_ns))


class FloatSource(FilmSource):
    def read(self, timeout_s):
        return replace(super().read(timeout_s), image=np.zeros((240, 320)))
