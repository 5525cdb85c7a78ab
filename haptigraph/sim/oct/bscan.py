"""Simulated intraoperative B-scans of a needle at the retina, each with its ground truth.

    camera = BscanCamera(ScanSettings(), BscanAppearance(), BscanNeedle(), seed=3)
    retina = Retina(RetinaShape(), camera.x_mm, seed=3)
    scan = camera.render(retina.advance(0.0, 0.0, tip_mm), tip_mm, direction, number=0)
    scan.image                       # (h, w) uint8, grey, log-compressed
    scan.truth.ilm_px, .rpe_px       # (w,) true row of each surface, sub-pixel, even where it is not visible
    scan.truth.ilm_lit, .rpe_lit     # (w,) False where the needle shadows the surface
    scan.truth.needle                # None, or .tip_px and .along_px, the shaft's direction towards the tip
    camera.classes(scan.truth)       # (h, w) uint8, indices into CLASSES

For random retinas, needles, appearances and artefacts: `scene = oct.scenes.random_scene(number, seed)`, then
`camera = scene.camera()` and `scene.take(camera)`. The same number and seed give the same image. Pixel
coordinates start at the centre of the top-left pixel; the eye frame's origin is the centre of the image, x
right, y up, mm. The RPE is the upper edge of its bright band.
"""

import math
from typing import Annotated

import cv2
import numpy as np
from msgspec import Meta, Struct
from numpy.typing import NDArray

from haptigraph.geometry import Vec, unit
from haptigraph.messages import Image
from haptigraph.projection import ImageGeometry
from haptigraph.sim.oct.appearance import (
    BscanAppearance,
    FieldBank,
    Level,
    PlainTissue,
    grey_from_power,
    intensity,
)
from haptigraph.sim.oct.artefacts import Artefacts
from haptigraph.sim.oct.layers import DetailedTissue, TissueDetail
from haptigraph.sim.oct.mimics import Mimics, MimicSettings
from haptigraph.sim.oct.needle import BscanNeedle, NeedlePx, needle_level, needle_light
from haptigraph.sim.oct.retina import Surfaces

__all__ = ["CLASSES", "Bscan", "BscanCamera", "BscanTruth", "ScanSettings", "scan_geometry"]

CLASSES = ("vitreous", "needle", "retina", "rpe_choroid", "shadow")
"""Names of the pixel classes, by index."""
MIN_LIGHT = 0.5  # pixels that receive a smaller share of the light are in shadow
CHOROID_MM = 0.2  # visible depth below the RPE
MOTTLE_DB, MOTTLE_PX = 2.0, 16  # uneven backscatter of tissue, in patches


class ScanSettings(Struct, frozen=True, forbid_unknown_fields=True):
    """The [scan] table of a scenario: size and scale of the B-scans, whose pixels are not square."""

    width_px: Annotated[int, Meta(ge=64, le=2048)] = 512
    height_px: Annotated[int, Meta(ge=64, le=2048)] = 512
    axial_mm_per_px: Annotated[float, Meta(ge=0.0005, le=0.05)] = 0.0033
    """In tissue; 3.379 mm over 1024 rows, as in a Leica Enfocus."""
    lateral_mm_per_px: Annotated[float, Meta(ge=0.0005, le=0.05)] = 0.0078
    """4 mm over 512 columns."""


class BscanTruth(Struct, frozen=True, eq=False):
    """Ground truth of a simulated B-scan; rows and flags by column, (w,)."""

    ilm_px: NDArray[np.float64]
    rpe_px: NDArray[np.float64]
    ilm_lit: NDArray[np.bool_]
    rpe_lit: NDArray[np.bool_]
    needle: NeedlePx | None = None
    """None: no needle is in the image."""
    is_pierced: bool = False
    """Whether the tip has punctured the ILM."""


class Bscan(Struct, frozen=True, eq=False):
    """One image and its ground truth."""

    image: Image
    truth: BscanTruth


class BscanCamera:
    """Render B-scans.

    Args:
        settings: Size and scale.
        appearance: Appearance of tissue, noise and artefacts.
        needle: Appearance of the needle.
        seed: Random seed.
        detail: Outer retina, lesions and choroid; None: a plain retina.
        mimics: Lines that cast no shadow; None: nothing.
    """

    def __init__(
        self,
        settings: ScanSettings,
        appearance: BscanAppearance,
        needle: BscanNeedle,
        seed: int,
        *,
        detail: TissueDetail | None = None,
        mimics: MimicSettings | None = None,
    ) -> None:
        self.settings, self.appearance, self.needle = settings, appearance, needle
        self.geometry = scan_geometry(settings)
        columns = np.arange(settings.width_px, dtype=np.float64)
        self.x_mm = (columns - (settings.width_px - 1) / 2) * settings.lateral_mm_per_px
        """Positions of the columns, eye frame, (w,)."""
        self._seed, self._size_px = seed, (settings.width_px, settings.height_px)
        self._bank = FieldBank(self._size_px, appearance, seed)
        self._plain_tissue = PlainTissue(appearance, settings.axial_mm_per_px)
        self._artefacts = Artefacts(
            appearance, settings.axial_mm_per_px, settings.lateral_mm_per_px, self._size_px, seed
        )
        axial_mm, height_px = settings.axial_mm_per_px, settings.height_px
        self.tissue = detail and DetailedTissue(detail, self.x_mm, axial_mm, height_px, seed)
        scale_mm = settings.lateral_mm_per_px, axial_mm
        self._mimics = mimics and Mimics(mimics, self._size_px, scale_mm, seed)

    def render(
        self, surfaces: Surfaces, tip_mm: Vec | None, direction: Vec = (0.0, -1.0), number: int = 0
    ) -> Bscan:
        """Render one B-scan.

        Args:
            surfaces: Surfaces of the healthy retina.
            tip_mm: The needle's tip, eye frame; None: there is no needle.
            direction: Direction of the shaft towards the tip, eye frame; it must point down.
            number: Number of the image; chooses the speckle.
        """
        rng = np.random.default_rng((self._seed, 24, number))
        healthy_rpe_px = self._row(surfaces.rpe_mm).astype(np.float32)
        surfaces = self.tissue.profiles.deformed(surfaces) if self.tissue else surfaces
        ilm_px, rpe_px = (
            self._row(height).astype(np.float32) for height in (surfaces.ilm_mm, surfaces.rpe_mm)
        )
        needle = None if tip_mm is None else self._needle_px(tip_mm, direction)
        level: Level = self._tissue_level(ilm_px, healthy_rpe_px, rng) * self._artefacts.vessel_light(ilm_px)
        level += self._artefacts.haze_level(ilm_px, rng)
        self._artefacts.add_floaters(level, ilm_px, rng)
        level = self._mimics.apply(level, ilm_px, rpe_px) if self._mimics else level
        metal: Level = np.zeros(1, np.float32)
        if needle is not None:
            level *= needle_light(needle, self.needle, self._size_px) ** 2  # light passes twice
            metal = np.sqrt(needle_level(needle, self.needle, ilm_px, self._size_px))
        level = np.sqrt(level)
        power = self._bank.power(level, metal, self.appearance, rng)
        floor = self._artefacts.streaks(needle.tip_px[1] if needle else None, rng)
        truth = self._truth(
            self._row(surfaces.ilm_mm), self._row(surfaces.rpe_mm), needle, surfaces.is_pierced
        )
        return Bscan(grey_from_power(power + floor, self.appearance), truth)

    def classes(self, truth: BscanTruth) -> Image:
        """Return the class of every pixel, (h, w) indices into `CLASSES`."""
        x, y = np.arange(float(self._size_px[0])), np.arange(float(self._size_px[1]))[:, None]
        classes = np.zeros((self._size_px[1], self._size_px[0]), np.uint8)
        deepest_px = truth.rpe_px + CHOROID_MM / self.settings.axial_mm_per_px
        classes[(y >= truth.ilm_px) & (y < truth.rpe_px)] = CLASSES.index("retina")
        classes[(y >= truth.rpe_px) & (y < deepest_px)] = CLASSES.index("rpe_choroid")
        if truth.needle is None:
            return classes
        classes[needle_light(truth.needle, self.needle, self._size_px) < MIN_LIGHT] = CLASSES.index("shadow")
        behind, across = truth.needle.along_and_across(x, y)
        is_metal = (np.abs(across) <= self.needle.width_px / 2) & (behind >= 0)
        classes[is_metal] = CLASSES.index("needle")
        return classes

    def _row(self, height_mm: NDArray[np.float64]) -> NDArray[np.float64]:
        return self.geometry.center_px[1] - height_mm / self.settings.axial_mm_per_px

    def _needle_px(self, tip_mm: Vec, direction: Vec) -> NeedlePx:
        right = direction[0] / self.settings.lateral_mm_per_px
        down = -direction[1] / self.settings.axial_mm_per_px
        return NeedlePx(self.geometry.to_px(tip_mm), unit((right, down)))

    def _tissue_level(self, ilm_px: Level, rpe_px: Level, rng: np.random.Generator) -> Level:
        """Return the mean intensity of the layers, (h, w)."""
        width, height = self._size_px
        coarse = rng.standard_normal((height // MOTTLE_PX + 2, width // MOTTLE_PX + 2), np.float32)
        mottle = np.float32(MOTTLE_DB) * cv2.resize(coarse, (width, height), interpolation=cv2.INTER_LINEAR)
        if self.tissue:
            return intensity(self.tissue.decibels(ilm_px, rpe_px, self.appearance) + mottle)
        return self._plain_tissue.level(ilm_px, rpe_px, mottle)

    def _truth(
        self,
        ilm_px: NDArray[np.float64],
        rpe_px: NDArray[np.float64],
        needle: NeedlePx | None,
        is_pierced: bool,
    ) -> BscanTruth:
        if needle is None:
            lit = np.ones(len(ilm_px), bool)
            return BscanTruth(ilm_px, rpe_px, lit, lit)
        x = np.arange(float(len(ilm_px)))
        is_lit = math.copysign(1.0, needle.along_px[0]) * (x - needle.tip_px[0]) > 0
        shaft_px = needle.y_at(x)
        return BscanTruth(
            ilm_px, rpe_px, is_lit | (ilm_px < shaft_px), is_lit | (rpe_px < shaft_px), needle, is_pierced
        )


def scan_geometry(settings: ScanSettings) -> ImageGeometry:
    """Return the geometry of B-scans: the eye frame's origin is the centre of the image."""
    middle_px = (settings.width_px - 1) / 2, (settings.height_px - 1) / 2
    return ImageGeometry(
        middle_px, settings.lateral_mm_per_px, False, axial_mm_per_px=settings.axial_mm_per_px
    )
