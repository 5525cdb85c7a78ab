"""Lines in simulated B-scans that resemble a needle or a surface, but cast no shadow.

Turns settings and a seed into added intensity (noise = 1): mirror lines, membranes in the vitreous, walls of
the choroid's vessels, saturated horizontal lines, the folded image of the retina; and into the light that
the pupil's edge blocks.
"""

import math
from typing import Annotated

import cv2
import numpy as np
from msgspec import Meta, Struct

from haptigraph.sim.oct.appearance import Level, intensity

__all__ = ["MimicSettings", "Mimics"]

Count = Annotated[int, Meta(ge=0, le=12)]
FADE_PX = 12.0  # over which the end of a line fades


class MimicSettings(Struct, frozen=True, forbid_unknown_fields=True):
    """What else is in a scan; by default nothing."""

    ghosts: Count = 0
    """Straight oblique lines anywhere, as of a needle outside the scan."""
    ghost_db: Annotated[float, Meta(ge=0, le=40)] = 18.0
    membranes: Count = 0
    """Thin curves in the vitreous, as of a detached hyaloid, or a membrane on the ILM."""
    walls: Count = 0
    """Oblique bright lines in retina, RPE and choroid, as of vessels along the scan."""
    wall_db: Annotated[float, Meta(ge=0, le=40)] = 20.0
    lines: Count = 0
    """Horizontal lines, whole or in part."""
    folded_db: Annotated[float, Meta(ge=-60, le=0)] = -60.0
    """Brightness of the retina's folded image relative to the retina; -60: there is none."""
    vignette_db: Annotated[float, Meta(ge=0, le=60)] = 0.0
    """Loss of light at one border of the image."""


class Mimics:
    """The mimics of one scene.

    Args:
        settings: Their number and brightness.
        size_px: (width, height) of the image.
        scale_mm: Lateral and axial scale [mm/px].
        seed: Random seed.
    """

    def __init__(
        self, settings: MimicSettings, size_px: tuple[int, int], scale_mm: tuple[float, float], seed: int
    ) -> None:
        self._settings, self._size_px, self._scale_mm, self._seed = settings, size_px, scale_mm, seed

    def apply(self, level: Level, ilm_px: Level, rpe_px: Level) -> Level:
        """Return the intensity with all mimics, (h, w)."""
        rng = np.random.default_rng((self._seed, 34))
        settings, (width, height) = self._settings, self._size_px
        if settings.folded_db > -60:
            level = level + self._folded(level, rng)
        if settings.vignette_db:
            level = level * self._vignette(rng)
        for _ in range(settings.ghosts):
            at = rng.uniform(0, width), rng.uniform(-0.2 * height, 0.9 * height)
            self._add_line(level, at, rng.uniform(10, 65), rng.uniform(0.3, 6.0), settings.ghost_db, rng)
        for _ in range(settings.walls):
            x = int(rng.integers(width))
            thick_px = rpe_px[x] - ilm_px[x]
            y = float(rpe_px[x] + rng.uniform(-0.6, 1.2) * thick_px)
            self._add_line(level, (x, y), rng.uniform(0, 40), rng.uniform(0.15, 1.5), settings.wall_db, rng)
        for _ in range(settings.membranes):
            self._add_membrane(level, ilm_px, rng)
        for _ in range(settings.lines):
            at = rng.uniform(0, width), rng.uniform(0, height)
            tilt_deg = 0.0 if rng.random() < 0.7 else rng.uniform(0, 4)
            self._add_line(
                level, at, tilt_deg, rng.choice([20.0, rng.uniform(0.3, 3)]), rng.uniform(6, 26), rng
            )
        return level

    def _add_line(
        self,
        level: Level,
        at_px: tuple[float, float],
        tilt_deg: float,
        length_mm: float,
        bright_db: float,
        rng: np.random.Generator,
    ) -> None:
        """Add a straight line through a point, in place; the tilt is in millimetres."""
        lateral_mm, axial_mm = self._scale_mm
        angle = math.radians(tilt_deg)
        dx, dy = math.cos(angle) / lateral_mm, math.sin(angle) / axial_mm
        dx = dx if rng.integers(2) else -dx
        norm = math.hypot(dx, dy)
        half_px, (dx, dy) = length_mm / 2 * norm, (dx / norm, dy / norm)
        width_px = rng.uniform(1.2, 7.0) if tilt_deg else rng.uniform(0.6, 2.5)
        x, y = np.arange(self._size_px[0], dtype=np.float32), np.arange(self._size_px[1], dtype=np.float32)
        off_x, off_y = x - np.float32(at_px[0]), (y - np.float32(at_px[1]))[:, None]
        near = np.flatnonzero(np.abs(off_y[:, 0]) <= half_px * abs(dy) + 4 * width_px + half_px * 0.02 + 2)
        off_y = off_y[near]
        across = np.abs(dx * off_y - dy * off_x)
        beyond = np.maximum(np.abs(dx * off_x + dy * off_y) - half_px, 0)
        db = bright_db * (1 - 2 * (across / np.float32(width_px)) ** 2) - 20 * (beyond / FADE_PX)
        level[near] += np.where(db > -6, intensity(db), 0)

    def _add_membrane(self, level: Level, ilm_px: Level, rng: np.random.Generator) -> None:
        width, height = self._size_px
        x = np.arange(width, dtype=np.float32)
        from_mm = rng.choice([0.0, rng.uniform(0.02, 0.5)])
        slope = rng.normal(0, 0.4) * self._scale_mm[0] / self._scale_mm[1]
        wave = (
            rng.uniform(0, 0.02)
            / self._scale_mm[1]
            * np.sin(x / width * rng.uniform(3, 20) + rng.uniform(0, 6))
        )
        row = ilm_px - from_mm / self._scale_mm[1] - np.abs(slope * (x - rng.uniform(0, width))) + wave
        if not from_mm:
            row = np.minimum(ilm_px + 1, row + rng.uniform(0, 60))  # attached in part
        y = np.arange(height, dtype=np.float32)[:, None]
        off = (y - row) / np.float32(rng.uniform(0.8, 2.5))
        db = np.float32(rng.uniform(6, 22)) - 6 * off**2
        level += np.where(db > -6, intensity(db), 0)

    def _folded(self, level: Level, rng: np.random.Generator) -> Level:
        """Return the image folded at the top, blurred as by dispersion."""
        height = self._size_px[1]
        flipped = np.roll(level[::-1], int(rng.uniform(-0.7, -0.2) * height), axis=0)
        blurred = cv2.GaussianBlur(np.ascontiguousarray(flipped), (0, 0), 1.0, sigmaY=rng.uniform(1, 8))
        return np.asarray(blurred * intensity(self._settings.folded_db), np.float32)

    def _vignette(self, rng: np.random.Generator) -> Level:
        width = self._size_px[0]
        x = np.arange(width, dtype=np.float32) / width
        x = x if rng.integers(2) else 1 - x
        extent = rng.uniform(0.05, 0.5)
        return intensity(-self._settings.vignette_db * np.clip(1 - x / extent, 0, 1) ** 1.5)
