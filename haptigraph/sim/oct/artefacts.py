"""Artefacts of simulated B-scans: vessel shadows, haze, floaters, saturated lines and A-scans.

Turns settings and a seed into added intensity (noise = 1) and blocked light. Vessels are fixed; everything
else is new in every image.
"""

import numpy as np

from haptigraph.sim.oct.appearance import BscanAppearance, Level, intensity

__all__ = ["Artefacts"]

VESSEL_MM, VESSEL_DEEP_MM = (0.02, 0.05), 0.04  # half width; depth below the ILM at which all light is lost
FLOATER_PX, FLOATER_DB, FLOATER_ABOVE_PX, REACH_PX = (1.2, 3.5), (14.0, 26.0), (6.0, 140.0), 12
STREAK_DB, COLUMN_DB = (3.0, 9.0), (4.0, 10.0)


class Artefacts:
    """The artefacts of one scene.

    Args:
        appearance: Their number and strength.
        axial_mm_per_px: Axial scale.
        lateral_mm_per_px: Lateral scale.
        size_px: (width, height) of the image.
        seed: Random seed.
    """

    def __init__(
        self,
        appearance: BscanAppearance,
        axial_mm_per_px: float,
        lateral_mm_per_px: float,
        size_px: tuple[int, int],
        seed: int,
    ) -> None:
        self._appearance, self._axial_mm, self._size_px = appearance, axial_mm_per_px, size_px
        rng = np.random.default_rng((seed, 23))
        x = np.arange(size_px[0], dtype=np.float32)
        lost_db = np.zeros(size_px[0], np.float32)
        for _ in range(appearance.vessels):
            off = (x - rng.uniform(0, size_px[0])) * lateral_mm_per_px / rng.uniform(*VESSEL_MM)
            lost_db += rng.uniform(0.5, 1.0) * appearance.vessel_db * np.exp(-(off**4)).astype(np.float32)
        self._vessel_light = intensity(-lost_db)

    def vessel_light(self, ilm_px: Level) -> Level:
        """Return the share of light that the vessels let through to each pixel, (h, w)."""
        y = np.arange(self._size_px[1], dtype=np.float32)[:, None]
        below = np.clip((y - ilm_px) * np.float32(self._axial_mm / VESSEL_DEEP_MM), 0, 1)
        return np.asarray(1 - below * (1 - self._vessel_light), np.float32)

    def haze_level(self, ilm_px: Level, rng: np.random.Generator) -> Level:
        """Return the intensity scattered by the vitreous, (h, 1) or (h, w)."""
        appearance = self._appearance
        y = np.arange(self._size_px[1], dtype=np.float32)[:, None]
        middle_px = float(ilm_px.mean()) - appearance.haze_mm / self._axial_mm
        off = (y - middle_px) * np.float32(self._axial_mm / appearance.haze_mm)
        band = intensity(appearance.haze_db + rng.uniform(-1, 1) - 3 * off**2)
        vitreous = intensity(appearance.vitreous_db) * (y < ilm_px)
        return np.asarray(band + vitreous, np.float32)

    def add_floaters(self, level: Level, ilm_px: Level, rng: np.random.Generator) -> None:
        """Add small bright floaters above the retina to an intensity, in place, (h, w)."""
        width, height = self._size_px
        for _ in range(self._appearance.floaters):
            x, size = int(rng.integers(0, width)), rng.uniform(*FLOATER_PX)
            y = round(float(ilm_px[x]) - rng.uniform(*FLOATER_ABOVE_PX))
            bright = intensity(rng.uniform(*FLOATER_DB))
            rows = np.arange(max(y - REACH_PX, 0), min(y + REACH_PX, height))
            columns = np.arange(max(x - REACH_PX, 0), min(x + REACH_PX, width))
            off = ((columns - x) / 1.6) ** 2 + ((rows - y) ** 2)[:, None]
            if len(rows):
                level[np.ix_(rows, columns)] += bright * np.exp(-off / size**2)

    def streaks(self, bevel_px: float | None, rng: np.random.Generator) -> Level:
        """Return the intensity of saturated lines and A-scans, (h, w); the first line is at the bevel."""
        width, height = self._size_px
        rows, columns = np.zeros((height, 1), np.float32), np.zeros((1, width), np.float32)
        for number in range(self._appearance.streaks):
            first = number == 0 and bevel_px is not None and 0 <= bevel_px < height
            row = round(bevel_px) if first and bevel_px is not None else int(rng.integers(0, height))
            rows[row] += intensity(rng.uniform(*STREAK_DB))
        for _ in range(self._appearance.columns):
            columns[:, rng.integers(0, width)] += intensity(rng.uniform(*COLUMN_DB))
        return rows + columns
