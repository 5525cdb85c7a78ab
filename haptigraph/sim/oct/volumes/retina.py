"""The simulated retina of a volume: ILM and RPE over x and z, with the deformation of `tissue`.

Turns time and the tip's position (eye frame, mm) into the true height of both surfaces at every A-scan. The
retina is part of a sphere, tilted in both directions, with smooth irregularity. Slices are acquired one after
the other, so breathing and heartbeat move the retina during a volume too.
"""

import math
from typing import NamedTuple

import numpy as np

from haptigraph.imaging import Floats
from haptigraph.sim.oct.retina import Retina, RetinaShape
from haptigraph.sim.tissue import Dent

__all__ = ["Heights", "VolumeRetina"]

WAVES = 7
MAX_SAG_SHARE = 0.8  # of the radius squared


class Heights(NamedTuple):
    """Heights of both surfaces at some points, eye frame."""

    ilm_mm: Floats
    rpe_mm: Floats


class VolumeRetina:
    """One retina.

    Args:
        shape: Its dimensions and motion; `tilt_deg` is its tilt along the slices.
        tilt_across_deg: Its tilt across the slices, rising with z.
        x_mm: Positions of the columns, (w,).
        z_mm: Positions of the slices, (n,).
        seed: Seed of its irregularity.
    """

    def __init__(
        self, shape: RetinaShape, tilt_across_deg: float, x_mm: Floats, z_mm: Floats, seed: int
    ) -> None:
        self.shape = shape
        self._slopes = math.tan(math.radians(shape.tilt_deg)), math.tan(math.radians(tilt_across_deg))
        rng = np.random.default_rng((seed, 31))
        self._upper, self._lower = _Waves(rng), _Waves(rng)
        self._x_mm, self._z_mm = x_mm[None, :], z_mm[:, None]
        self._rest = self.rest_mm(self._x_mm, self._z_mm)
        self._motion = Retina(shape, x_mm, seed)
        self.restart()

    def restart(self) -> None:
        """Return to the resting surfaces."""
        self._dent = Dent(self.shape, np.zeros_like(self._rest.ilm_mm))
        self._dent_mm = np.zeros_like(self._rest.ilm_mm)
        self._tip_dent_mm = 0.0

    @property
    def is_pierced(self) -> bool:
        """Whether the tip has punctured the ILM."""
        return self._dent.is_pierced

    def rest_mm(self, x_mm: Floats, z_mm: Floats) -> Heights:
        """Return the resting surfaces at some points; x and z broadcast."""
        shape = self.shape
        square = np.minimum(x_mm**2 + z_mm**2, MAX_SAG_SHARE * shape.radius_mm**2)
        sag_mm = shape.radius_mm - np.sqrt(shape.radius_mm**2 - square)
        plane_mm = shape.height_mm + self._slopes[0] * x_mm + self._slopes[1] * z_mm
        ilm_mm = plane_mm + sag_mm + shape.waves_mm * self._upper.at(x_mm, z_mm)
        rpe_mm = ilm_mm - shape.thickness_mm + shape.waves_mm / 2 * self._lower.at(x_mm, z_mm)
        return Heights(ilm_mm, rpe_mm)

    def motion_mm(self, time_s: float) -> float:
        """Return the displacement of the whole retina by breathing and heartbeat."""
        return self._motion.motion_mm(time_s)

    def press(self, elapsed_s: float, tip_mm: Floats | None, time_s: float) -> None:
        """Deform the retina.

        Args:
            elapsed_s: Time since the last call.
            tip_mm: The tip at `time_s`, (x, y, z), eye frame; None: no tip is near.
            time_s: The time at which the tip is there.
        """
        if tip_mm is None:
            self._dent_mm, self._tip_dent_mm = self._dent.press(elapsed_s, None, None), 0.0
            return
        x, y, z = tip_mm
        depth_mm = float(self.rest_mm(x, z).ilm_mm) + self.motion_mm(time_s) - float(y)
        away_mm = np.hypot(self._x_mm - x, self._z_mm - z)
        self._dent_mm = self._dent.press(elapsed_s, away_mm, depth_mm)
        share = self.shape.drag_share if self.is_pierced else 1.0
        nearest = np.unravel_index(int(away_mm.argmin()), away_mm.shape)
        self._tip_dent_mm = max(max(depth_mm, 0.0) * share, float(self._dent_mm[nearest]))

    def heights(self, moved_mm: Floats) -> Heights:
        """Return both surfaces at every A-scan, (n, w), moved by some distance in each slice, (n,)."""
        moved = moved_mm[:, None]
        ilm_mm = self._rest.ilm_mm + moved - self._dent_mm
        return Heights(ilm_mm, self._rest.rpe_mm + moved - self.shape.rpe_share * self._dent_mm)

    def at_tip(self, tip_mm: Floats, time_s: float) -> Heights:
        """Return both surfaces above or below the tip that `press` was given last."""
        rest, moved_mm = self.rest_mm(tip_mm[0], tip_mm[2]), self.motion_mm(time_s)
        return Heights(
            rest.ilm_mm + moved_mm - self._tip_dent_mm,
            rest.rpe_mm + moved_mm - self.shape.rpe_share * self._tip_dent_mm,
        )

    def rpe_cosine(self, tip_mm: Floats) -> float:
        """Return the cosine of the angle between the resting RPE's normal at the tip and the beam."""
        x, _, z = tip_mm
        step_mm = 0.05
        xs, zs = np.array([x + step_mm, x - step_mm, x, x]), np.array([z, z, z + step_mm, z - step_mm])
        right, left, near, far = self.rest_mm(xs, zs).rpe_mm
        return float(1 / math.sqrt(1 + ((right - left) ** 2 + (near - far) ** 2) / (2 * step_mm) ** 2))


class _Waves:
    """A smooth random function of x and z with an RMS of about 1."""

    def __init__(self, rng: np.random.Generator) -> None:
        directions, lengths_mm = rng.uniform(0, math.pi, WAVES), rng.uniform(0.6, 2.5, WAVES)
        self._x_rad_mm = 2 * math.pi * np.cos(directions) / lengths_mm
        self._z_rad_mm = 2 * math.pi * np.sin(directions) / lengths_mm
        self._phases = rng.uniform(0, 2 * math.pi, WAVES)

    def at(self, x_mm: Floats, z_mm: Floats) -> Floats:
        x, z = np.asarray(x_mm)[..., None], np.asarray(z_mm)[..., None]
        waves = np.sin(x * self._x_rad_mm + z * self._z_rad_mm + self._phases)
        return np.asarray(waves.sum(axis=-1) * math.sqrt(2 / WAVES), np.float64)
