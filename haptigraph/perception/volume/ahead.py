"""Where the tip will be, relative to the retina, when a state is output and until the next one.

A volume is old when its state is output, and the state lasts until the next. Turns the tips of successive
volumes into the place where the tip will be at a later time: a Kalman filter of constant velocity (Kalman
1960; Bar-Shalom et al. 2001) for the tip, and one for the retina's own motion along the beam. Both are driven
by random accelerations, so that the standard deviation grows with the horizon. There is no clock: only stamps
count. The predicted tip is given relative to the surfaces of the present volume: its distance from them is
the distance that is expected later.
"""

import math
from typing import NamedTuple

import numpy as np
from msgspec import Struct

from haptigraph.imaging import Floats
from haptigraph.perception.volume.surfaces import HeightMap

__all__ = ["Ahead", "AheadSettings", "TipAhead", "imaged_ns"]

NS_PER_S = 1e9
GATE_SD = 5.0  # a tip further than this from its prediction starts the filter again


class AheadSettings(Struct, frozen=True):
    """How far to predict, and what motion to expect."""

    latency_s: float = 0.06
    """From the end of a volume to the output of its state."""
    period_s: float = 0.25
    """From one volume to the next."""
    tip_mm_s2: float = 0.15
    """Standard deviation of the tip's acceleration, per axis: a hand or robot that starts and stops."""
    retina_mm_s2: float = 0.2
    """The same of the retina along the beam: breathing of 80 um at 0.3 Hz has an RMS of 0.2 mm/s2."""
    tip_speed_mm_s: float = 0.2
    """Standard deviation of the tip's velocity per axis, before it is known."""
    retina_speed_mm_s: float = 0.1
    """The same of the retina."""
    tremor_mm: float = 0.006
    """Motion too fast for the rate of volumes, tremor and heartbeat: added to what is measured."""
    surface_mm: float = 0.004
    """Standard deviation of a surface's measured displacement between volumes."""
    max_sd_mm: float = 0.3
    """A prediction less certain than this is not given."""

    @property
    def horizon_s(self) -> float:
        """From a volume's stamp to the end of its output."""
        return self.latency_s + self.period_s


class Ahead(NamedTuple):
    """The predicted tip, eye frame, relative to the surfaces of the present volume."""

    tip_mm: Floats
    """(3,)."""
    sd_mm: Floats
    """Standard deviation along x, y and z, (3,)."""
    velocity_mm_s: Floats
    """Of the tip relative to the retina, (3,)."""


class TipAhead:
    """Predict the tip.

    Args:
        settings: How far to predict, and what motion to expect.
    """

    def __init__(self, settings: AheadSettings) -> None:
        self.settings = settings
        """May change between volumes, with their period."""
        self.reset()

    def reset(self) -> None:
        """Forget all volumes."""
        self._tip: list[_Axis] = []
        self._retina = _Axis(0.0, 0.0, 0.0)
        self._moved_mm = 0.0
        self._surface: HeightMap | None = None
        self._imaged_ns = 0

    def update(
        self,
        stamp_ns: int,
        imaged_ns: int,
        tip_mm: Floats | None,
        tip_sd_mm: Floats,
        surface: HeightMap | None,
    ) -> Ahead | None:
        """Process one volume; return the prediction for the end of its output, None if it is too uncertain.

        Args:
            stamp_ns: Stamp of the volume.
            imaged_ns: When the slice that contains the tip was acquired, at most `stamp_ns`.
            tip_mm: The tip, (3,); None: not found.
            tip_sd_mm: Its standard deviation, (3,).
            surface: The surface that matters, usually the RPE; None: not found.
        """
        elapsed_s = (imaged_ns - self._imaged_ns) / NS_PER_S
        if self._tip and elapsed_s <= 0:
            self.reset()
        if not self._tip:
            if tip_mm is None:
                return None
            self._start(tip_mm, tip_sd_mm)
        else:
            self._advance(elapsed_s)
            if tip_mm is not None:
                self._measure_tip(tip_mm, tip_sd_mm)
            if surface is not None and self._surface is not None:
                self._measure_retina(surface, self._surface)
        self._imaged_ns = imaged_ns
        if surface is not None:
            self._surface = surface
        return self._predicted((stamp_ns - imaged_ns) / NS_PER_S + self.settings.horizon_s)

    def _start(self, tip_mm: Floats, tip_sd_mm: Floats) -> None:
        settings = self.settings
        self._tip = [
            _Axis(float(at), math.hypot(float(sd), settings.tremor_mm), settings.tip_speed_mm_s)
            for at, sd in zip(tip_mm, tip_sd_mm, strict=True)
        ]
        self._retina = _Axis(0.0, settings.surface_mm, settings.retina_speed_mm_s)
        self._moved_mm = 0.0

    def _advance(self, elapsed_s: float) -> None:
        for axis in self._tip:
            axis.advance(elapsed_s, self.settings.tip_mm_s2)
        self._retina.advance(elapsed_s, self.settings.retina_mm_s2)

    def _measure_tip(self, tip_mm: Floats, tip_sd_mm: Floats) -> None:
        sds = [math.hypot(float(sd), self.settings.tremor_mm) for sd in tip_sd_mm]
        off = [axis.innovation_sd(float(at), sd) for axis, at, sd in zip(self._tip, tip_mm, sds, strict=True)]
        if max(off) > GATE_SD:
            self._start(tip_mm, tip_sd_mm)
            return
        for axis, at, sd in zip(self._tip, tip_mm, sds, strict=True):
            axis.measure(float(at), sd)

    def _measure_retina(self, surface: HeightMap, before: HeightMap) -> None:
        """Add how far the surface moved below the tip since the volume before."""
        x, z = np.array(self._tip[0].place), np.array(self._tip[2].place)
        self._moved_mm += float(surface.at(x, z) - before.at(x, z))
        settings = self.settings
        self._retina.measure(self._moved_mm, math.hypot(settings.surface_mm, settings.tremor_mm))

    def _predicted(self, horizon_s: float) -> Ahead | None:
        settings = self.settings
        tip = [axis.after(horizon_s, settings.tip_mm_s2) for axis in self._tip]
        retina_mm, retina_sd_mm = self._retina.after(horizon_s, settings.retina_mm_s2)
        at = np.array([place for place, _ in tip])
        sd = np.array([each for _, each in tip])
        at[1] -= retina_mm - self._moved_mm
        sd[1] = math.hypot(sd[1], retina_sd_mm)
        if sd.max() > settings.max_sd_mm:
            return None
        velocity = np.array([axis.velocity for axis in self._tip])
        velocity[1] -= self._retina.velocity
        return Ahead(at, sd, velocity)


class _Axis:
    """A Kalman filter of constant velocity along one axis."""

    def __init__(self, at_mm: float, sd_mm: float, speed_mm_s: float) -> None:
        self._state = np.array([at_mm, 0.0])
        self._cov = np.diag([sd_mm**2, speed_mm_s**2])

    @property
    def place(self) -> float:
        """The estimated place."""
        return float(self._state[0])

    @property
    def velocity(self) -> float:
        """The estimated velocity."""
        return float(self._state[1])

    def advance(self, elapsed_s: float, push_mm_s2: float) -> None:
        """Advance in time."""
        self._state, self._cov = self._moved(elapsed_s, push_mm_s2)

    def after(self, elapsed_s: float, push_mm_s2: float) -> tuple[float, float]:
        """Return place and standard deviation after some time."""
        state, cov = self._moved(elapsed_s, push_mm_s2)
        return float(state[0]), math.sqrt(float(cov[0, 0]))

    def innovation_sd(self, at_mm: float, sd_mm: float) -> float:
        """Return how far a measurement is from the prediction, in standard deviations."""
        return abs(at_mm - float(self._state[0])) / math.sqrt(float(self._cov[0, 0]) + sd_mm**2)

    def measure(self, at_mm: float, sd_mm: float) -> None:
        """Add a measurement."""
        gain = self._cov[:, 0] / (self._cov[0, 0] + sd_mm**2)
        self._state = self._state + gain * (at_mm - self._state[0])
        self._cov = self._cov - np.outer(gain, self._cov[0])

    def _moved(self, elapsed_s: float, push_mm_s2: float) -> tuple[Floats, Floats]:
        step = np.array([[1.0, elapsed_s], [0.0, 1.0]])
        push = np.array([elapsed_s**2 / 2, elapsed_s])
        noise = push_mm_s2**2 * np.outer(push, push)
        return step @ self._state, step @ self._cov @ step.T + noise


def imaged_ns(stamp_ns: int, at_z_mm: float, surface: HeightMap, acquisition_s: float) -> int:
    """Return when the slice at some z was acquired, if slices follow one another and end at the stamp.

    Args:
        stamp_ns: Stamp of the volume, when its last slice is acquired.
        at_z_mm: Position along the slices.
        surface: Any surface of the volume, for the positions of the slices.
        acquisition_s: Duration of a volume; 0: its slices are acquired at once.
    """
    first, last = float(surface.z_mm[0]), float(surface.z_mm[-1])
    share = min(max((at_z_mm - first) / (last - first), 0.0), 1.0)
    return stamp_ns - round((1 - share) * acquisition_s * NS_PER_S)
