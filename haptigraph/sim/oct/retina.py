"""The simulated retina of a B-scan: two surfaces deformed by a needle and moved by breathing and heartbeat.

Turns time and the tip's position (eye frame, mm) into the true ILM and RPE in every column, with the
deformation of `tissue`. Amplitudes of the cardiac motion: de Kinkelder et al. 2011, IOVS 52(6). Forces and
blebs are not modelled.
"""

import math
from typing import Annotated, NamedTuple

import numpy as np
from msgspec import Meta

from haptigraph.geometry import Vec
from haptigraph.imaging import Floats
from haptigraph.sim.tissue import Dent, Share, TissueShape

__all__ = ["Retina", "RetinaShape", "Surfaces"]


class RetinaShape(TissueShape, frozen=True, forbid_unknown_fields=True):
    """The [retina] table of a B-scan scenario."""

    height_mm: Annotated[float, Meta(ge=-3, le=3)] = -0.1
    """Height of the resting ILM above the centre of the image."""
    thickness_mm: Annotated[float, Meta(ge=0.1, le=0.6)] = 0.3
    """From ILM to RPE."""
    tilt_deg: Annotated[float, Meta(ge=-30, le=30)] = 4.0
    """Counter-clockwise, in millimetres and not in pixels."""
    radius_mm: Annotated[float, Meta(ge=5, le=1e6)] = 14.0
    """Radius of curvature; the retina is concave and rises to both sides."""
    waves_mm: Annotated[float, Meta(ge=0, le=0.1)] = 0.008
    """RMS amplitude of its irregularity; the thickness varies by half of it."""
    rpe_share: Share = 0.4
    """Depth of the RPE's dent, as a share of the ILM's."""
    breathing_mm: Annotated[float, Meta(ge=0, le=1)] = 0.05
    """Amplitude of the axial motion of the whole retina."""
    breathing_hz: Annotated[float, Meta(ge=0, le=5)] = 0.22
    heartbeat_mm: Annotated[float, Meta(ge=0, le=0.5)] = 0.012
    heartbeat_hz: Annotated[float, Meta(ge=0, le=5)] = 1.1


class Surfaces(NamedTuple):
    """The retina at one moment: heights in the eye frame by column, (w,)."""

    ilm_mm: Floats
    rpe_mm: Floats
    is_pierced: bool
    """Whether the tip has punctured the ILM."""


class Retina:
    """One retina.

    Args:
        shape: Its dimensions and motion.
        x_mm: Positions of the columns, eye frame, ascending, (w,).
        seed: Seed of its irregularity.
    """

    def __init__(self, shape: RetinaShape, x_mm: Floats, seed: int) -> None:
        self._shape, self._x_mm = shape, x_mm
        rng = np.random.default_rng((seed, 21))
        sag_mm = shape.radius_mm - np.sqrt(shape.radius_mm**2 - np.minimum(x_mm**2, 0.8 * shape.radius_mm**2))
        slope = math.tan(math.radians(shape.tilt_deg))
        self._ilm_mm = shape.height_mm + slope * x_mm + sag_mm + shape.waves_mm * _waves(rng, x_mm)
        self._rpe_mm = self._ilm_mm - shape.thickness_mm + shape.waves_mm / 2 * _waves(rng, x_mm)
        self._beats = rng.uniform(0, 2 * math.pi, 2)
        self._dent = Dent(shape, x_mm)

    def restart(self) -> None:
        """Return to the resting surfaces."""
        self._dent.restart()

    def rest_mm(self, x_mm: float) -> float:
        """Return the height of the resting ILM at some x."""
        return float(np.interp(x_mm, self._x_mm, self._ilm_mm))

    def motion_mm(self, time_s: float) -> float:
        """Return the displacement of the whole retina by breathing and heartbeat."""
        shape = self._shape
        breath = math.sin(2 * math.pi * shape.breathing_hz * time_s + self._beats[0])
        pulse = math.sin(2 * math.pi * shape.heartbeat_hz * time_s + self._beats[1])
        return shape.breathing_mm * breath + shape.heartbeat_mm * (0.7 * pulse + 0.3 * pulse**3)

    def advance(self, time_s: float, elapsed_s: float, tip_mm: Vec | None) -> Surfaces:
        """Advance in time and return the surfaces.

        Args:
            time_s: The time now.
            elapsed_s: Time since the last call.
            tip_mm: The needle's tip now, eye frame; None: no tip is near.
        """
        moved_mm = self.motion_mm(time_s)
        tip = tip_mm and (tip_mm[0], self.rest_mm(tip_mm[0]) + moved_mm - tip_mm[1])
        dent_mm = self._dent.advance(elapsed_s, tip)
        ilm_mm = self._ilm_mm + moved_mm - dent_mm
        rpe_mm = self._rpe_mm + moved_mm - self._shape.rpe_share * dent_mm
        return Surfaces(ilm_mm, rpe_mm, self._dent.is_pierced)


def _waves(rng: np.random.Generator, x_mm: Floats) -> Floats:
    """Return a smooth random curve with an RMS of about 1."""
    lengths_mm, phases = rng.uniform(0.6, 2.5, 5), rng.uniform(0, 2 * math.pi, 5)
    waves = np.sin(2 * math.pi * x_mm / lengths_mm[:, None] + phases[:, None])
    return np.asarray(waves.sum(axis=0) * math.sqrt(2 / 5), np.float64)
