"""Appearance of simulated B-scans: backscatter, speckle and noise under log compression.

Grey is linear in the decibels of mean intensity above the noise. Where many scatterers share a pixel, the
field is a sum of many random phases: complex Gaussian, with Rayleigh amplitude and exponential intensity
(Goodman 1976, JOSA 66(11); in OCT: Schmitt et al. 1999, J. Biomed. Opt. 4(1)). The standard deviation of its
logarithm is 5.57 dB for any mean. Speckle grains have the size of the resolution, detector noise that of a
pixel. Every image has new speckle.
"""

from typing import Annotated, Any, TypeAlias

import cv2
import numpy as np
from msgspec import Meta, Struct
from numpy.typing import NDArray

from haptigraph.messages import Image

__all__ = [
    "BscanAppearance",
    "FieldBank",
    "Level",
    "PlainTissue",
    "grey_from_power",
    "intensity",
]

Level: TypeAlias = NDArray[np.floating[Any]]
"""Mean intensity of every pixel, noise = 1, or its root, (h, w)."""

EXPONENTIAL_DB = -2.507  # mean of 10 log10 of an exponential variable of mean 1
BANK_EXTRA_PX = 192
MIN_INTENSITY = np.float32(1e-6)
# (relative depth from ILM to RPE, dB above the noise): nerve fibres, ganglion cells, nuclei, and so on.
RETINA_DB = (
    *((-0.02, 0.0), (0.02, 19.0), (0.08, 22.0), (0.34, 21.0), (0.38, 18.5), (0.5, 18.0)),
    *((0.54, 19.5), (0.6, 18.0), (0.66, 15.0), (0.93, 13.5), (0.985, 14.5), (1.015, 20.0), (1.06, 22.5)),
)
RPE_MM, CHOROID_DB_PER_MM = 0.05, 90.0  # thickness of the band, and attenuation below it
MAX_DB = np.float32(60.0)
METAL_GRAIN = 0.4  # speckle of metal, as a share of its amplitude
MAX_FIELDS, FEW_FIELDS = 16, 4  # more looks than the first are simulated from the second number of fields
TABLE_FROM, TABLE_SPAN, TABLE_STEPS = 0.2, 4.0, 2048
"""Start, extent and length of the table of `_tissue_db`, in units of the distance from ILM to RPE."""
DARK_DB = -60.0


class BscanAppearance(Struct, frozen=True, forbid_unknown_fields=True):
    """The [appearance] table of a B-scan scenario."""

    signal_db: Annotated[float, Meta(ge=-15, le=10)] = 0.0
    """Backscatter of tissue relative to the default; negative: a noisier scan."""
    contrast_db: Annotated[float, Meta(ge=-15, le=10)] = 0.0
    """Added brightness of the RPE and everything below it."""
    attenuation_db_per_mm: Annotated[float, Meta(ge=0, le=60)] = 6.0
    """Additional attenuation below the ILM."""
    vitreous_db: Annotated[float, Meta(ge=-20, le=10)] = 0.0
    """Backscatter of the vitreous, above the noise."""
    grey_per_db: Annotated[float, Meta(ge=1, le=20)] = 5.8
    noise_grey: Annotated[float, Meta(ge=5, le=150)] = 60.0
    """Mean grey of pure noise."""
    lateral_grain_px: Annotated[float, Meta(ge=0.3, le=6)] = 0.8
    axial_grain_px: Annotated[float, Meta(ge=0.3, le=6)] = 0.6
    """Standard deviations of the point spread function, which also sets the size of speckle grains."""
    looks: Annotated[int, Meta(ge=1, le=128)] = 1
    """Number of scans averaged in intensity, which reduces speckle; above 16 it is reduced by scaling."""
    vessels: Annotated[int, Meta(ge=0, le=20)] = 2
    vessel_db: Annotated[float, Meta(ge=0, le=40)] = 8.0
    """Two-way loss of light in a vessel."""
    streaks: Annotated[int, Meta(ge=0, le=20)] = 0
    """Number of thin horizontal saturated lines, the first at the needle's bevel."""
    columns: Annotated[int, Meta(ge=0, le=20)] = 0
    """Number of A-scans that are too bright over their whole depth."""
    haze_db: Annotated[float, Meta(ge=-20, le=20)] = -20.0
    """Peak brightness of a haze above the retina, above the noise."""
    haze_mm: Annotated[float, Meta(ge=0.02, le=2)] = 0.2
    """Width of the haze, and its approximate height above the ILM."""
    floaters: Annotated[int, Meta(ge=0, le=50)] = 2

    @property
    def fields(self) -> int:
        """Number of simulated fields."""
        return self.looks if self.looks <= MAX_FIELDS else FEW_FIELDS


class FieldBank:
    """Random complex fields of unit power; a random cut-out is much cheaper than a new field.

    Args:
        size_px: (width, height) of the cut-outs.
        style: Determines the size of speckle grains.
        seed: Seed of the fields.
    """

    def __init__(self, size_px: tuple[int, int], style: BscanAppearance, seed: int) -> None:
        width, height = size_px
        rng = np.random.default_rng((seed, 22))
        shape = (height + BANK_EXTRA_PX, width + BANK_EXTRA_PX, 2)
        self._size_px = size_px
        noise = rng.standard_normal(shape, np.float32) * np.float32(np.sqrt(0.5))
        blurred = cv2.GaussianBlur(
            rng.standard_normal(shape, np.float32),
            (0, 0),
            style.lateral_grain_px,
            sigmaY=style.axial_grain_px,
        )
        grains = np.asarray(blurred, np.float32)
        grains *= np.float32(np.sqrt(0.5) / grains.std())
        # NumPy is several times faster with long rows than with pairs of numbers.
        self._grains, self._noise = (field.transpose(2, 0, 1).copy() for field in (grains, noise))

    def cut(self, rng: np.random.Generator) -> tuple[Level, Level]:
        """Return random cut-outs of speckle and noise, (2, h, w) each: real and imaginary part."""
        return self._part(self._grains, rng), self._part(self._noise, rng)

    def power(
        self, root_level: Level, metal: Level, style: BscanAppearance, rng: np.random.Generator
    ) -> Level:
        """Return the power of tissue, metal and detector noise together, averaged over looks, (h, w).

        Args:
            root_level: Amplitude of the tissue, (h, w).
            metal: Amplitude of metal, broadcast to (h, w); it scatters with little speckle.
            style: Determines how many looks are averaged.
            rng: Chooses the speckle.
        """
        amplitude = root_level + np.float32(METAL_GRAIN) * metal
        power = sum(self._look(amplitude, metal, rng) for _ in range(style.fields)) / np.float32(style.fields)
        if style.looks == style.fields:
            return np.asarray(power)
        mean = amplitude**2 + metal**2 + 1  # more looks than are drawn: their average is nearer to it
        return np.asarray(mean + np.float32((style.fields / style.looks) ** 0.5) * (power - mean))

    def _look(self, amplitude: Level, metal: Level, rng: np.random.Generator) -> Level:
        """Return the power of one look, (h, w)."""
        grains, noise = self.cut(rng)
        field = amplitude * grains
        field += noise
        field[0] += metal
        real, imaginary = np.square(field, dtype=np.float32)
        real += imaginary
        return np.asarray(real)

    def _part(self, field: Level, rng: np.random.Generator) -> Level:
        (width, height), (left, top) = self._size_px, rng.integers(0, BANK_EXTRA_PX, 2)
        part = field[:, top : top + height, left : left + width]
        return part[..., ::-1] if rng.integers(2) else part


def intensity(db: Level | float) -> Level:
    """Convert decibels to intensity."""
    return np.exp(np.minimum(np.asarray(db, np.float32), MAX_DB) * np.float32(np.log(10) / 10))


def _tissue_db(style: BscanAppearance, layers_mm: float) -> Level:
    """Return the backscatter of tissue by depth [dB above the noise], as a table.

    Args:
        style: Appearance of the tissue.
        layers_mm: From ILM to RPE, the unit of depth; the table runs from `-TABLE_FROM` over `TABLE_SPAN`.
    """
    depth = np.linspace(-TABLE_FROM, TABLE_SPAN - TABLE_FROM, TABLE_STEPS)
    below_mm = (depth - 1) * layers_mm
    db = np.interp(depth, *np.array(RETINA_DB).T) + style.signal_db
    db += np.where(depth > 1, style.contrast_db, 0.0)
    db -= style.attenuation_db_per_mm * np.clip(depth, 0, 1) * layers_mm
    db -= np.maximum(below_mm - RPE_MM, 0) * CHOROID_DB_PER_MM
    db[depth < RETINA_DB[0][0]] = DARK_DB
    return np.asarray(np.maximum(db, DARK_DB), np.float32)


class PlainTissue:
    """The layers of a plain retina.

    Args:
        style: Appearance of the layers.
        axial_mm: Height of a row.
    """

    def __init__(self, style: BscanAppearance, axial_mm: float) -> None:
        self._style, self._axial_mm = style, axial_mm
        self._tables: dict[float, Level] = {}

    def level(self, ilm_px: Level, rpe_px: Level, mottle_db: Level) -> Level:
        """Return the mean intensity, (h, w).

        Args:
            ilm_px: Row of the ILM in each column, (w,).
            rpe_px: Row of the RPE, (w,).
            mottle_db: Uneven backscatter, (h, w).
        """
        thick_px = rpe_px - ilm_px
        layers_mm = round(float(thick_px.mean()) * self._axial_mm, 3)
        if layers_mm not in self._tables:
            self._tables[layers_mm] = _tissue_db(self._style, layers_mm)
        table = self._tables[layers_mm]
        y = np.arange(len(mottle_db), dtype=np.float32)[:, None]
        deeper = np.maximum(y - rpe_px, 0) * np.float32(self._axial_mm / layers_mm)
        share = np.minimum((y - ilm_px) / thick_px, 1) + deeper
        index = ((share + np.float32(TABLE_FROM)) * np.float32(len(table) / TABLE_SPAN)).astype(np.int32)
        return intensity(table[np.clip(index, 0, len(table) - 1)] + mottle_db)


def grey_from_power(power: Level, style: BscanAppearance) -> Image:
    """Turn power, noise = 1, into a log-compressed image, (h, w)."""
    decibel = np.log(np.maximum(power, MIN_INTENSITY)) * np.float32(10 / np.log(10))
    grey = np.float32(style.grey_per_db) * (decibel - np.float32(EXPONENTIAL_DB)) + np.float32(
        style.noise_grey
    )
    return np.asarray(np.clip(np.rint(grey), 0, 255), np.uint8)
