"""Detailed tissue of simulated B-scans: outer retinal bands, lesions, and a choroid with vessels.

Turns surfaces (px) into the backscatter of every pixel (dB above the noise). `appearance` has a plain retina
instead, without choroid. Bands and their order: Staurenghi et al. 2014, Ophthalmology 121(8); the thickness
of the choroid: Margolis and Spaide 2009, AJO 147(5).
"""

from typing import Annotated

import cv2
import numpy as np
from msgspec import Meta, Struct

from haptigraph.imaging import Floats
from haptigraph.sim.oct.appearance import RETINA_DB, BscanAppearance, Level
from haptigraph.sim.oct.lesions import (
    COMPLEX_MM,
    EPITHELIUM_MM,
    LesionProfiles,
    LesionSettings,
    lesion_profiles,
)

__all__ = ["DetailedTissue", "TissueDetail"]

Decibels = Annotated[float, Meta(ge=-30, le=40)]
DARK_DB = -60.0
ZONE_MM, GAP_MM = 0.016, 0.037  # lower edges of the ellipsoid zone and of the darker band below it
MEMBRANE_MM, CAPILLARIES_MM = 0.009, 0.02
FLAT_PX = 1.2  # half width of the smooth edges between layers
OUTER_SHARE = 0.985
SEEN_FLUID_MM = 0.006


class TissueDetail(Struct, frozen=True, forbid_unknown_fields=True):
    """Brightness of bands, choroid and lesions [dB above the noise], and what else is in a scan."""

    lesions: LesionSettings = LesionSettings()
    zone_db: Decibels = 21.0
    """Ellipsoid zone."""
    gap_db: Decibels = 17.0
    """Between ellipsoid zone and RPE."""
    rpe_db: Decibels = 24.0
    membrane_db: Decibels = 17.0
    """Bruch's membrane, where it is bare or apart from the RPE."""
    choroid_db: Decibels = 16.0
    choroid_mm: Annotated[float, Meta(ge=0.03, le=0.8)] = 0.25
    choroid_db_per_mm: Annotated[float, Meta(ge=0, le=120)] = 25.0
    """Attenuation below Bruch's membrane."""
    lumen_db: Decibels = -8.0
    """Brightness of the choroid's vessels relative to the tissue around them."""
    lumen_mm: Annotated[float, Meta(ge=0.01, le=0.3)] = 0.06
    sclera_db: Decibels = 2.0
    """Brightness of the sclera relative to the choroid."""
    fluid_db: Decibels = -2.0
    drusen_db: Decibels = 12.0
    transmission_db: Decibels = 7.0
    """Added brightness of the choroid below a patch of atrophy."""
    focus_db: Decibels = 24.0
    layer_db: tuple[float, ...] = ()
    """Added to the bands of `RETINA_DB` from the vitreous downwards; empty: nothing."""


class DetailedTissue:
    """The tissue of one scene.

    Args:
        detail: Its brightness and lesions.
        x_mm: Positions of the columns, eye frame, ascending, (w,).
        axial_mm_per_px: Axial scale.
        height_px: Height of the image.
        seed: Random seed.
    """

    def __init__(
        self, detail: TissueDetail, x_mm: Floats, axial_mm_per_px: float, height_px: int, seed: int
    ) -> None:
        self._detail, self._axial_mm, self._height_px = detail, axial_mm_per_px, height_px
        self._x_mm, self._rng_seed = x_mm, (seed, 32)
        self.profiles: LesionProfiles = lesion_profiles(detail.lesions, x_mm, seed)
        self._choroid = self._choroid_db(np.random.default_rng((seed, 33)))

    def decibels(self, ilm_px: Level, healthy_rpe_px: Level, style: BscanAppearance) -> Level:
        """Return the mean backscatter of every pixel, (h, w).

        Args:
            ilm_px: Row of the ILM in each column, (w,).
            healthy_rpe_px: Row at which the ellipsoid zone would begin without lesions, (w,).
            style: Brightness and attenuation of the whole tissue.
        """
        profiles, axial_mm = self.profiles, self._axial_mm
        membrane_px = healthy_rpe_px + COMPLEX_MM / axial_mm
        floor_px = membrane_px - profiles.lift_mm / axial_mm
        top_px = floor_px - (COMPLEX_MM * (1 - profiles.atrophy) + profiles.fluid_mm) / axial_mm
        y = np.arange(self._height_px, dtype=np.float32)[:, None]
        rows = (part.astype(np.float32) for part in (ilm_px, top_px, floor_px, membrane_px))
        ilm, top, floor, membrane = rows
        db = self._retina_db(y, ilm, top, style)
        below_db = self._band_db(y, top, floor, membrane) + style.contrast_db
        below_db -= style.attenuation_db_per_mm * (top - ilm) * axial_mm
        below_db += style.signal_db
        inside = np.clip((y - top) / (2 * FLAT_PX) + 0.5, 0, 1)
        db = np.where(y < top - FLAT_PX, db, inside * below_db + (1 - inside) * db)
        self._add_foci(db, ilm, top)
        return np.asarray(np.where(y < ilm, DARK_DB, db), np.float32)

    def _retina_db(self, y: Level, ilm: Level, top: Level, style: BscanAppearance) -> Level:
        """Return the backscatter between ILM and ellipsoid zone, with cysts."""
        thick_px = np.maximum(top - ilm, 4)
        usual_px = np.float32(np.median(thick_px))
        # Swelling and pit change the inner layers more than the outer ones.
        share = 1 - (1 - (y - ilm) / thick_px) * (thick_px / usual_px) ** np.float32(0.4)
        depth, level_db = (np.array(part) for part in zip(*RETINA_DB, strict=True))
        extra = self._detail.layer_db
        level_db[1 : 1 + len(extra)] += np.array(extra[: len(level_db) - 1])
        level_db[0] = level_db[1]
        kept = depth < OUTER_SHARE + 1e-6
        db = np.interp(np.clip(share, 0, OUTER_SHARE), depth[kept], level_db[kept]) + style.signal_db
        db -= style.attenuation_db_per_mm * np.clip(y - ilm, 0, None) * self._axial_mm
        for cyst in self.profiles.cysts:
            middle = ilm + cyst.share * thick_px
            off = ((self._x_mm - cyst.x_mm) / cyst.half_width_mm) ** 2 + (
                (y - middle) * np.float32(self._axial_mm / cyst.half_height_mm)
            ) ** 2
            db = np.where(off < 1, np.minimum(db, self._detail.fluid_db), db)
        return np.asarray(db, np.float32)

    def _band_db(self, y: Level, top: Level, floor: Level, membrane: Level) -> Level:
        """Return the backscatter from the photoreceptors' inner segments downwards."""
        detail, axial_mm, profiles = self._detail, np.float32(self._axial_mm), self.profiles
        lost = profiles.atrophy.astype(np.float32)
        from_top = (y - top) * axial_mm
        above_floor = (floor - y) * axial_mm
        db = np.where(from_top < ZONE_MM, detail.zone_db, detail.gap_db)
        has_fluid = profiles.fluid_mm > SEEN_FLUID_MM
        is_fluid = has_fluid & (from_top > ZONE_MM + 0.01) & (above_floor > EPITHELIUM_MM)
        db = np.where(is_fluid, detail.fluid_db, db)
        is_epithelium = (above_floor >= 0) & (above_floor <= EPITHELIUM_MM)
        db = np.where(is_epithelium, detail.rpe_db * (1 - lost) + detail.membrane_db * lost, db)
        below = -above_floor
        content_db = np.where(profiles.is_serous, detail.fluid_db, detail.drusen_db)
        db = np.where(below > 0, content_db, db)
        from_membrane = (y - membrane) * axial_mm
        is_membrane = (np.abs(from_membrane) < MEMBRANE_MM / 2) & (below >= 0)
        db = np.where(is_membrane, detail.membrane_db, db)
        index = np.clip((y - membrane).astype(np.int32), 0, len(self._choroid) - 1)
        choroid_db = np.take_along_axis(self._choroid, index, axis=0)
        shaded_db = np.minimum(profiles.lift_mm.astype(np.float32) * 12, 4)
        choroid_db = choroid_db + detail.transmission_db * lost - shaded_db
        return np.asarray(np.where(from_membrane > MEMBRANE_MM / 2, choroid_db, db), np.float32)

    def _choroid_db(self, rng: np.random.Generator) -> Level:
        """Return the choroid's backscatter by depth below Bruch's membrane, (h, w)."""
        detail, axial_mm = self._detail, self._axial_mm
        width, lateral_mm = len(self._x_mm), float(self._x_mm[1] - self._x_mm[0])
        depth_mm = np.arange(self._height_px, dtype=np.float32)[:, None] * np.float32(axial_mm)
        field = np.zeros((self._height_px, width), np.float32)
        for size_mm, lowest_mm in ((detail.lumen_mm / 2, 0.0), (detail.lumen_mm, 0.3 * detail.choroid_mm)):
            noise = rng.standard_normal(field.shape, np.float32)
            across, down = max(1.3 * size_mm / lateral_mm, 0.6), max(0.6 * size_mm / axial_mm, 0.6)
            shape = max(8, int(width / across)), max(8, int(self._height_px / down))
            coarse = cv2.GaussianBlur(noise[: shape[1], : shape[0]], (0, 0), 0.8)
            smooth = cv2.resize(coarse, (width, self._height_px), interpolation=cv2.INTER_CUBIC)
            field = np.where(depth_mm >= lowest_mm, smooth / max(float(smooth.std()), 1e-6), field)
        lumen = np.clip((field - 0.1) / 0.4, 0, 1) * (depth_mm > CAPILLARIES_MM)
        edge_mm = detail.choroid_mm * (
            1 + 0.15 * np.sin(self._x_mm / rng.uniform(0.2, 1.2) + rng.uniform(0, 6))
        )
        is_sclera = np.clip((depth_mm - edge_mm.astype(np.float32)) / 0.02 + 0.5, 0, 1)
        db = detail.choroid_db - detail.choroid_db_per_mm * depth_mm
        db = db + detail.lumen_db * lumen * (1 - is_sclera) + detail.sclera_db * is_sclera
        return np.asarray(np.maximum(db, DARK_DB), np.float32)

    def _add_foci(self, db: Level, ilm: Level, top: Level) -> None:
        """Add bright spots and their shadows, in place."""
        rng = np.random.default_rng(self._rng_seed)
        height, width = db.shape
        lateral_mm = float(self._x_mm[1] - self._x_mm[0])
        for _ in range(self._detail.lesions.foci):
            x, share, size_mm = int(rng.integers(width)), rng.uniform(0.15, 0.95), rng.uniform(0.01, 0.04)
            across, down = max(size_mm / lateral_mm, 0.8), max(size_mm / self._axial_mm, 1.0)
            columns = np.arange(max(0, x - 3 * round(across) - 1), min(width, x + 3 * round(across) + 2))
            y = np.arange(height, dtype=np.float32)[:, None]
            middle = ilm[x] + share * (top[x] - ilm[x])
            off = ((columns - x) / across) ** 2 + ((y - middle) / down) ** 2
            lost_db = rng.uniform(2, 12) * np.exp(-(((columns - x) / across) ** 2)) * (y > middle)
            part = db[:, columns] - lost_db.astype(np.float32)
            db[:, columns] = np.where(off < 1, self._detail.focus_db, part)
