"""The simulated retina of a B-scan: two surfaces that a needle dents, that spring back, and that breathe.

Turns time and the tip's place (eye frame, mm) into the true ILM and RPE of every column. Each column is a
standard linear solid (Zener 1948, Elasticity and Anelasticity of Metals): a spring beside a spring and a
dashpot in series, so that a released surface jumps back in part and creeps back for the rest. How far a dent
reaches is a stretched membrane on a bed of springs (Winkler 1867): it falls off exponentially from the tip.
That the retina is viscoelastic: Ferrara et al. 2021, Eye 35(7). Amplitudes of the heart's motion: de
Kinkelder et al. 2011, IOVS 52(6). How much the retina gives before the tip goes through, and the time
constant, differ between eyes and are set by a scenario: nobody measured them in a living eye. Knows no
images, no force, and no bleb.
"""

import math
from typing import Annotated, NamedTuple

import numpy as np
from msgspec import Meta, Struct
from numpy.typing import NDArray

from haptigraph.geometry import Vec

__all__ = ["Retina", "RetinaShape", "Surfaces"]

Columns = NDArray[np.float64]
Share = Annotated[float, Meta(ge=0, le=1)]


class RetinaShape(Struct, frozen=True, forbid_unknown_fields=True):
    """The [retina] table of a B-scan's scenario."""

    height_mm: Annotated[float, Meta(ge=-3, le=3)] = -0.1
    """Of the ILM above the middle of the image, in the middle column, at rest."""
    thickness_mm: Annotated[float, Meta(ge=0.1, le=0.6)] = 0.3
    """From ILM to RPE."""
    tilt_deg: Annotated[float, Meta(ge=-30, le=30)] = 4.0
    """Counter-clockwise, in millimetres and not in pixels."""
    radius_mm: Annotated[float, Meta(ge=5, le=1e6)] = 14.0
    """Of its curvature; the eye is hollow, so it rises to both sides."""
    waves_mm: Annotated[float, Meta(ge=0, le=0.1)] = 0.008
    """Strength (RMS) of its irregularity; the thickness varies by half of it."""
    dent_mm: Annotated[float, Meta(ge=0.05, le=3)] = 0.45
    """A dent is 1/e as deep so far beside the tip."""
    puncture_mm: Annotated[float, Meta(ge=0, le=1)] = 0.08
    """The tip goes through when it has pushed the ILM in so deep."""
    drag_share: Share = 0.3
    """Of the tip's depth below the resting ILM: what the ILM stays pushed in by once the tip is through."""
    rpe_share: Share = 0.4
    """Of the ILM's dent: what the RPE is pushed in by."""
    prompt_share: Share = 0.6
    """Of a dent: what springs back at once when it is released."""
    relax_s: Annotated[float, Meta(ge=0.01, le=60)] = 0.6
    """Time constant of the dashpot."""
    breathing_mm: Annotated[float, Meta(ge=0, le=1)] = 0.05
    """Amplitude of the whole retina's up and down."""
    breathing_hz: Annotated[float, Meta(ge=0, le=5)] = 0.22
    heartbeat_mm: Annotated[float, Meta(ge=0, le=0.5)] = 0.012
    heartbeat_hz: Annotated[float, Meta(ge=0, le=5)] = 1.1


class Surfaces(NamedTuple):
    """The retina at one moment; heights in the eye frame, (w,) each, the image's left column first."""

    ilm_mm: Columns
    rpe_mm: Columns
    is_pierced: bool
    """Whether the tip is through the ILM."""


class Retina:
    """One retina.

    Args:
        shape: Its measures.
        x_mm: Where the columns are, eye frame, rising, (w,).
        seed: Of its irregularity.
    """

    def __init__(self, shape: RetinaShape, x_mm: Columns, seed: int) -> None:
        self._shape, self._x_mm = shape, x_mm
        rng = np.random.default_rng((seed, 21))
        sag_mm = shape.radius_mm - np.sqrt(shape.radius_mm**2 - np.minimum(x_mm**2, 0.8 * shape.radius_mm**2))
        slope = math.tan(math.radians(shape.tilt_deg))
        self._ilm_mm = shape.height_mm + slope * x_mm + sag_mm + shape.waves_mm * _waves(rng, x_mm)
        self._rpe_mm = self._ilm_mm - shape.thickness_mm + shape.waves_mm / 2 * _waves(rng, x_mm)
        self._beats = rng.uniform(0, 2 * math.pi, 2)
        self.restart()

    def restart(self) -> None:
        """Lie at rest."""
        self._crept_mm = np.zeros_like(self._x_mm)
        self._is_pierced = False

    def rest_mm(self, x_mm: float) -> float:
        """Return the height of the ILM at some x, with nothing moving."""
        return float(np.interp(x_mm, self._x_mm, self._ilm_mm))

    def motion_mm(self, time_s: float) -> float:
        """Return how far breath and heart have lifted the whole retina."""
        shape = self._shape
        breath = math.sin(2 * math.pi * shape.breathing_hz * time_s + self._beats[0])
        pulse = math.sin(2 * math.pi * shape.heartbeat_hz * time_s + self._beats[1])
        return shape.breathing_mm * breath + shape.heartbeat_mm * (0.7 * pulse + 0.3 * pulse**3)

    def advance(self, time_s: float, elapsed_s: float, tip_mm: Vec | None) -> Surfaces:
        """Move on to a moment.

        Args:
            time_s: The moment.
            elapsed_s: Since the moment before.
            tip_mm: The needle's tip then, eye frame; None: there is none near.
        """
        moved_mm = self.motion_mm(time_s)
        held_mm = self._held_mm(tip_mm, moved_mm)
        free_mm = (1 - self._shape.prompt_share) * self._crept_mm
        dent_mm = np.maximum(free_mm, held_mm)
        self._crept_mm += (dent_mm - self._crept_mm) * -math.expm1(-elapsed_s / self._shape.relax_s)
        ilm_mm = self._ilm_mm + moved_mm - dent_mm
        return Surfaces(ilm_mm, self._rpe_mm + moved_mm - self._shape.rpe_share * dent_mm, self._is_pierced)

    def _held_mm(self, tip_mm: Vec | None, moved_mm: float) -> Columns:
        """Return how deep the needle holds each column down."""
        if tip_mm is None or not self._x_mm[0] <= tip_mm[0] <= self._x_mm[-1]:
            self._is_pierced = False
            return np.zeros_like(self._x_mm)
        depth_mm = self.rest_mm(tip_mm[0]) + moved_mm - tip_mm[1]
        self._is_pierced = depth_mm > 0 and (self._is_pierced or depth_mm > self._shape.puncture_mm)
        share = self._shape.drag_share if self._is_pierced else 1.0
        return max(depth_mm, 0.0) * share * np.exp(-np.abs(self._x_mm - tip_mm[0]) / self._shape.dent_mm)


def _waves(rng: np.random.Generator, x_mm: Columns) -> Columns:
    """Return a smooth random course with a strength of about 1."""
    lengths_mm, phases = rng.uniform(0.6, 2.5, 5), rng.uniform(0, 2 * math.pi, 5)
    waves = np.sin(2 * math.pi * x_mm / lengths_mm[:, None] + phases[:, None])
    return np.asarray(waves.sum(axis=0) * math.sqrt(2 / 5), np.float64)
