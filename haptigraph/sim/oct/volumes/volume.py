"""Simulated OCT volumes of a needle at the retina, each with its ground truth in 3D.

    scene = scenes.random_volume_scene(number, seed)
    volume = scene.take()
    volume.image                     # (h, n * w) uint8: the n B-scans side by side
    volume.truth.needle              # None, or tip, axis and bevel where the tip was acquired, eye frame, mm
    volume.truth.ilm_mm, .rpe_mm     # (n, w) heights, also where they are not visible
    volume.truth.ilm_lit, .rpe_lit   # (n, w) False in the needle's shadow

`volume.image.reshape(h, n, w)` is the volume by axial rows, slices and lateral columns. The eye frame has
its origin in the volume's centre: x right along the columns, y up against the beam, z along the slices, mm.
Slices are acquired one after the other, so needle and retina move between them. Every slice has new speckle.
"""

import math
from functools import cached_property
from typing import Annotated, NamedTuple

import cv2
import numpy as np
from msgspec import Meta, Struct
from msgspec.structs import replace

from haptigraph.imaging import Floats, Mask
from haptigraph.messages import Image
from haptigraph.sim.oct.appearance import (
    BscanAppearance,
    FieldBank,
    Level,
    PlainTissue,
    grey_from_power,
    intensity,
)
from haptigraph.sim.oct.artefacts import Artefacts
from haptigraph.sim.oct.bscan import ScanSettings
from haptigraph.sim.oct.volumes.needle import NeedlePose, SliceNeedle, VolumeNeedle, needle_in_slice, upper_mm

__all__ = ["Grid", "Volume", "VolumeCamera", "VolumeSettings", "VolumeTruth"]

VESSEL_MM, VESSEL_DEEP_MM = (0.02, 0.05), 0.04  # half width; depth below the ILM at which all light is lost
MOTTLE_DB, MOTTLE_MM = 2.0, 0.12  # uneven backscatter of tissue, in patches


class VolumeSettings(Struct, frozen=True, forbid_unknown_fields=True):
    """The [volume] table of a scenario: what a volume has beyond its B-scans."""

    slices: Annotated[int, Meta(ge=2, le=512)] = 48
    slice_mm: Annotated[float, Meta(ge=0.001, le=0.5)] = 0.05
    """Distance between two slices."""
    tilt_deg: Annotated[float, Meta(ge=-30, le=30)] = 2.0
    """Tilt of the retina across the slices, rising with z."""
    jitter_mm: Annotated[float, Meta(ge=0, le=0.1)] = 0.003
    """Standard deviation of the retina's random axial displacement from slice to slice."""


class Grid:
    """Positions of all voxels of a volume, eye frame.

    Args:
        scan: Size and scale of a slice.
        volume: Number and distance of the slices.
    """

    def __init__(self, scan: ScanSettings, volume: VolumeSettings) -> None:
        self.shape = scan.height_px, volume.slices, scan.width_px
        """Axial rows, slices, lateral columns."""
        self.voxel_mm = scan.axial_mm_per_px, volume.slice_mm, scan.lateral_mm_per_px
        """Axial, between slices, lateral."""
        self.y_mm = -_centred(scan.height_px) * scan.axial_mm_per_px
        self.z_mm = _centred(volume.slices) * volume.slice_mm
        self.x_mm = _centred(scan.width_px) * scan.lateral_mm_per_px

    def index(self, at_mm: Floats) -> tuple[float, float, float]:
        """Return row, slice and column of a point, sub-voxel."""
        x, y, z = (float(value) for value in at_mm)
        (height, slices, width), (axial_mm, slice_mm, lateral_mm) = self.shape, self.voxel_mm
        return (
            (height - 1) / 2 - y / axial_mm,
            (slices - 1) / 2 + z / slice_mm,
            (width - 1) / 2 + x / lateral_mm,
        )

    def contains(self, at_mm: Floats) -> bool:
        """Return whether a point is in the volume."""
        index = self.index(at_mm)
        return all(-0.5 <= at <= size - 0.5 for at, size in zip(index, self.shape, strict=True))


class VolumeTruth(Struct, frozen=True, eq=False, dict=True):
    """Ground truth of a simulated volume, eye frame; surfaces by slice and column, (n, w)."""

    grid: Grid
    shape: VolumeNeedle
    ilm_mm: Floats
    rpe_mm: Floats
    poses: tuple[NeedlePose | None, ...]
    """Of the needle in every slice, at the time at which the slice is acquired."""
    needle: NeedlePose | None = None
    """When the slice that contains the tip is acquired; None: there is no needle."""
    tip_ilm_mm: float = 0.0
    """Height of the ILM above or below the tip, at the same time."""
    tip_rpe_mm: float = 0.0
    rpe_tilt_deg: float = 0.0
    """Angle between the RPE's normal at the tip and the beam."""
    tip_time_s: float = 0.0
    """When the tip is acquired."""
    is_pierced: bool = False
    """Whether the tip has punctured the ILM."""

    @property
    def rpe_cosine(self) -> float:
        """Cosine of the RPE's tilt."""
        return math.cos(math.radians(self.rpe_tilt_deg))

    @property
    def gap_mm(self) -> float:
        """The tip's distance from the RPE along its normal; positive above."""
        return 0.0 if self.needle is None else self.rpe_cosine * (self.needle.tip_mm[1] - self.tip_rpe_mm)

    @cached_property
    def metal_mm(self) -> Floats:
        """Height of the needle's upper side at each A-scan, minus infinity beside it, (n, w)."""
        tops = np.full(self.ilm_mm.shape, -np.inf)
        for number, needle in enumerate(self.poses):
            if needle is not None:
                tops[number] = upper_mm(needle, self.shape, self.grid.x_mm, self.grid.z_mm[number])[0]
        return tops

    @cached_property
    def ilm_lit(self) -> Mask:
        """Whether light reaches the ILM, (n, w)."""
        return np.asarray(self.metal_mm <= self.ilm_mm, np.bool_)

    @cached_property
    def rpe_lit(self) -> Mask:
        """Whether light reaches the RPE, (n, w)."""
        return np.asarray(self.metal_mm <= self.rpe_mm, np.bool_)


class Volume(NamedTuple):
    """One volume and its ground truth."""

    image: Image
    """(h, n * w): the B-scans side by side."""
    truth: VolumeTruth


class VolumeCamera:
    """Render volumes.

    Args:
        scan: Size and scale of a slice.
        volume: Number and distance of the slices.
        appearance: Appearance of tissue, noise and artefacts.
        needle: Dimensions and appearance of the needle.
        seed: Random seed.
    """

    def __init__(
        self,
        scan: ScanSettings,
        volume: VolumeSettings,
        appearance: BscanAppearance,
        needle: VolumeNeedle,
        seed: int,
    ) -> None:
        self.grid, self.appearance, self.needle = Grid(scan, volume), appearance, needle
        self._seed, self._axial_mm = seed, scan.axial_mm_per_px
        size_px = scan.width_px, scan.height_px
        self._bank = FieldBank(size_px, appearance, seed)
        self._artefacts = Artefacts(
            replace(appearance, vessels=0), scan.axial_mm_per_px, scan.lateral_mm_per_px, size_px, seed
        )
        self._vessel_light = _vessel_light(self.grid, appearance, seed)
        self._mottle = _mottle(self.grid, seed)
        self._tissue = PlainTissue(appearance, scan.axial_mm_per_px)

    def render(self, truth: VolumeTruth, number: int = 0) -> Image:
        """Render one volume, (h, n * w); `number` chooses the speckle."""
        height, slices, width = self.grid.shape
        image = np.empty((height, slices, width), np.uint8)
        rows_px = ((height - 1) / 2 - surface / self._axial_mm for surface in (truth.ilm_mm, truth.rpe_mm))
        ilm_px, rpe_px = (rows.astype(np.float32) for rows in rows_px)
        for at, needle in enumerate(truth.poses):
            metal = needle and needle_in_slice(
                needle, self.needle, self.grid.x_mm, self.grid.z_mm[at], self.grid.y_mm, truth.ilm_mm[at]
            )
            image[:, at] = self._slice(at, ilm_px[at], rpe_px[at], metal, number)
        return image.reshape(height, slices * width)

    def _slice(self, at: int, ilm_px: Level, rpe_px: Level, needle: SliceNeedle | None, number: int) -> Image:
        """Render one slice, (h, w)."""
        rng = np.random.default_rng((self._seed, 34, number, at))
        level = self._tissue.level(ilm_px, rpe_px, self._mottle[at])
        y = np.arange(len(level), dtype=np.float32)[:, None]
        below = np.clip((y - ilm_px) * np.float32(self._axial_mm / VESSEL_DEEP_MM), 0, 1)
        level *= 1 - below * (1 - self._vessel_light[at])
        level += self._artefacts.haze_level(ilm_px, rng)
        self._artefacts.add_floaters(level, ilm_px, rng)
        metal: Level = np.zeros(1, np.float32)
        if needle is not None:
            level[:, needle.columns] *= needle.light**2  # light passes twice
            metal = np.zeros_like(level)
            metal[:, needle.columns] = np.sqrt(needle.metal)
        level = np.sqrt(level)
        power = self._bank.power(level, metal, self.appearance, rng)
        rows = np.random.default_rng((self._seed, 35))  # saturated lines are in the same rows of all slices
        return grey_from_power(power + self._artefacts.streaks(None, rows), self.appearance)


def _centred(count: int) -> Floats:
    return np.arange(float(count)) - (count - 1) / 2


def _vessel_light(grid: Grid, appearance: BscanAppearance, seed: int) -> Level:
    """Return the share of light that vessels let through, (n, w): bands that cross the slices."""
    rng = np.random.default_rng((seed, 33))
    x, z = grid.x_mm[None, :], grid.z_mm[:, None]
    lost_db = np.zeros(grid.shape[1:], np.float32)
    for _ in range(appearance.vessels):
        turn, start_x = rng.uniform(0, np.pi), rng.uniform(grid.x_mm[0], grid.x_mm[-1])
        bend, half_mm = rng.uniform(-0.15, 0.15), rng.uniform(*VESSEL_MM)
        along = np.cos(turn) * z + np.sin(turn) * (x - start_x)
        off = -np.sin(turn) * z + np.cos(turn) * (x - start_x) + bend * along**2
        lost_db += rng.uniform(0.5, 1.0) * appearance.vessel_db * np.exp(-((off / half_mm) ** 4))
    return intensity(-lost_db)


def _mottle(grid: Grid, seed: int) -> Level:
    """Return uneven backscatter [dB], (n, h, w): a coarse random field, interpolated along two directions."""
    rng = np.random.default_rng((seed, 36))
    height, slices, width = grid.shape
    down, across, right = (
        int(size * voxel_mm / MOTTLE_MM) + 2 for size, voxel_mm in zip(grid.shape, grid.voxel_mm, strict=True)
    )
    coarse = rng.standard_normal((across, down, right), np.float32)
    at = np.linspace(0, across - 1, slices)
    first = np.minimum(at.astype(int), across - 2)
    share = (at - first).astype(np.float32)[:, None, None]
    blended = (1 - share) * coarse[first] + share * coarse[first + 1]
    return np.stack(
        [MOTTLE_DB * cv2.resize(one, (width, height), interpolation=cv2.INTER_LINEAR) for one in blended]
    ).astype(np.float32)
