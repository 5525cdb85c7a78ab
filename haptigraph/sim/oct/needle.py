"""The simulated needle of a B-scan: a thin bright ridge with a bevel, its shadow, and its mirror artefact.

Turns the needle's position (px) into the intensity that each pixel scatters and the light that reaches it.
Metal blocks the light, so there is only noise below it. The part above the image's top folds back into the
image, as in Fourier-domain OCT: a fainter line of opposite slope, the ghost.
"""

import math
from typing import Annotated, NamedTuple

import numpy as np
from msgspec import Meta, Struct

from haptigraph.geometry import Vec
from haptigraph.sim.oct.appearance import Level, intensity

__all__ = ["BscanNeedle", "NeedlePx", "needle_level", "needle_light"]

BLOB_RADIUS_SHARE = 0.9  # radius of the bevel's bright spot, in widths of the ridge


class BscanNeedle(Struct, frozen=True, forbid_unknown_fields=True):
    """The [needle] table of a B-scan scenario."""

    width_px: Annotated[float, Meta(ge=1, le=40)] = 5.0
    """Width of the ridge at half its brightness (in decibels above the noise)."""
    bright_db: Annotated[float, Meta(ge=0, le=50)] = 30.0
    """Brightness of the ridge, above the noise."""
    tissue_loss_db: Annotated[float, Meta(ge=0, le=50)] = 17.0
    """Loss of brightness inside tissue."""
    bevel_px: Annotated[float, Meta(ge=0, le=80)] = 14.0
    """From the end of the continuous line to the tip, which a second bright spot marks."""
    gap_db: Annotated[float, Meta(ge=0, le=50)] = 12.0
    """Loss of brightness between line and spot."""
    edge_px: Annotated[float, Meta(ge=0.3, le=20)] = 3.0
    """Half width of the shadow's soft edge."""
    ghost_db: Annotated[float, Meta(ge=0, le=60)] = 60.0
    """Attenuation of the ghost; 60: there is none."""


class NeedlePx(NamedTuple):
    """Position of a needle in the image."""

    tip_px: Vec
    along_px: Vec
    """Direction of the shaft towards the tip, length 1; it points down."""

    @property
    def angle_deg(self) -> float:
        """Angle of the shaft in pixels, from the x axis downwards, 0 to 180."""
        return math.degrees(math.atan2(self.along_px[1], self.along_px[0]))

    def along_and_across(self, x_px: Level, y_px: Level) -> tuple[Level, Level]:
        """Return the distances of points behind the tip along the shaft, and across the shaft."""
        (dx, dy), off_x, off_y = self.along_px, x_px - self.tip_px[0], y_px - self.tip_px[1]
        return -(dx * off_x + dy * off_y), dy * off_x - dx * off_y

    def x_at(self, y_px: Level) -> Level:
        """Return the shaft's columns at given rows."""
        slope = self.along_px[0] / self.along_px[1]
        return np.asarray(self.tip_px[0] + slope * (y_px - self.tip_px[1]), np.float32)

    def y_at(self, x_px: Level) -> Level:
        """Return the shaft's rows at given columns."""
        slope = self.along_px[1] / self.along_px[0]
        return np.asarray(self.tip_px[1] + slope * (x_px - self.tip_px[0]), np.float64)


def needle_light(needle: NeedlePx, style: BscanNeedle, size_px: tuple[int, int]) -> Level:
    """Return the share of light that the needle lets through to each pixel, 0 to 1, (h, w)."""
    width, height = size_px
    x, y = np.arange(width, dtype=np.float32), np.arange(height, dtype=np.float32)[:, None]
    side = math.copysign(1.0, needle.along_px[0])
    free = _step(side * (x - np.float32(needle.tip_px[0])) / np.float32(style.edge_px))
    below = needle.along_px[1] * side * (needle.x_at(y) - x) / np.float32(style.width_px)
    return np.asarray(np.maximum(free, _step(-below - 1)), np.float32)


def needle_level(needle: NeedlePx, style: BscanNeedle, ilm_px: Level, size_px: tuple[int, int]) -> Level:
    """Return the mean intensity that the needle scatters, noise = 1, (h, w).

    Args:
        needle: Its position.
        style: Its appearance.
        ilm_px: Row of the ILM in each column, (w,).
        size_px: (width, height) of the image.
    """
    x, y = np.arange(size_px[0], dtype=np.float32), np.arange(size_px[1], dtype=np.float32)[:, None]
    behind, across = needle.along_and_across(x, y)
    db = _profile_db(behind, across, style) - style.tissue_loss_db * _step((y - ilm_px) / 4 - 1)
    level = intensity(db)
    if style.ghost_db < 60:
        top_px = float(needle.x_at(np.zeros(1))[0])
        mirrored = needle.along_px[1] * (x - top_px) + needle.along_px[0] * y
        faint_db = style.bright_db - style.ghost_db
        ghost_db = faint_db * (1 - 2 * (mirrored / np.float32(1.6 * style.width_px)) ** 2)
        level = level + intensity(ghost_db)
    return np.asarray(level, np.float32)


def _profile_db(behind: Level, across: Level, style: BscanNeedle) -> Level:
    """Return the ridge's brightness [dB] by the distances behind the tip and across the shaft."""
    sharp = np.float32(2 * style.bright_db / style.width_px**2)
    line = style.bright_db - sharp * across**2 - 4 * np.maximum(style.bevel_px - behind, 0) ** 2 / 9
    bevel = (
        style.bright_db - style.gap_db - sharp * across**2 - 30 * ((behind < 0) | (behind > style.bevel_px))
    )
    radius_px = BLOB_RADIUS_SHARE * style.width_px  # the spot is half as bright at the tip
    blob = style.bright_db * (1 - 0.5 * (across**2 + (behind - radius_px) ** 2) / radius_px**2)
    return np.asarray(np.maximum(np.maximum(line, bevel), blob), np.float32)


def _step(at: Level) -> Level:
    """Return a smooth step from 0 (below -1) to 1 (above 1)."""
    share = np.clip((at + 1) / 2, 0, 1)
    return np.asarray(share * share * (3 - 2 * share), np.float32)
