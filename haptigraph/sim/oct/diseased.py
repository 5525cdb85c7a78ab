"""Random B-scans with detailed tissue, healthy or diseased, of many devices; with or without needle.

A scene holds all parameters of a B-scan, drawn from a number and a seed; `scenes` draws plain retinas.
"""

from typing import Any

import numpy as np
from msgspec.structs import replace

from haptigraph.sim.oct.appearance import RETINA_DB, BscanAppearance
from haptigraph.sim.oct.bscan import ScanSettings
from haptigraph.sim.oct.layers import TissueDetail
from haptigraph.sim.oct.lesions import LesionSettings
from haptigraph.sim.oct.mimics import MimicSettings
from haptigraph.sim.oct.retina import RetinaShape
from haptigraph.sim.oct.scenes import BscanScene, random_scene

__all__ = ["random_detailed_scene"]

Rng = np.random.Generator


def random_detailed_scene(
    number: int,
    seed: int = 0,
    *,
    diseased: bool,
    place: str = "none",
    size_px: tuple[int, int] = (512, 512),
) -> BscanScene:
    """Draw the parameters of a random B-scan with detailed tissue.

    Args:
        number: Number of the scene.
        seed: Seed of all scenes.
        diseased: Whether it has lesions.
        place: Position of the tip, one of `scenes.PLACES`; by default there is no needle.
        size_px: (width, height) of the image.
    """
    plain = random_scene(number, seed, size_px=size_px, place=place)
    rng = np.random.default_rng((seed, 26, number))
    scan = _scan(rng, size_px)
    shift = plain.tip_x_mm / (plain.scan.width_px * plain.scan.lateral_mm_per_px)
    return replace(
        plain,
        scan=scan,
        retina=_retina(rng, scan, plain.retina, deep=place != "none"),
        appearance=_appearance(rng, plain.appearance),
        tip_x_mm=shift * scan.width_px * scan.lateral_mm_per_px,
        detail=_detail(rng, _lesions(rng) if diseased else LesionSettings(pit_mm=_pit_mm(rng))),
        mimics=_mimics(rng),
    )


def _scan(rng: Rng, size_px: tuple[int, int]) -> ScanSettings:
    width, height = size_px
    return ScanSettings(
        width_px=width,
        height_px=height,
        axial_mm_per_px=rng.uniform(1.1, 2.3) / height,
        lateral_mm_per_px=rng.uniform(2.5, 9.0) / width,
    )


def _retina(rng: Rng, scan: ScanSettings, plain: RetinaShape, *, deep: bool) -> RetinaShape:
    """Draw a retina; deep in the image, so that a needle above it has room."""
    low, high = (-0.25, 0.1) if deep else (-0.12, 0.3)
    return replace(
        plain,
        height_mm=rng.uniform(low, high) * scan.height_px * scan.axial_mm_per_px,
        thickness_mm=rng.uniform(0.18, 0.36),
        tilt_deg=rng.uniform(-7, 7),
        radius_mm=float(rng.choice([rng.uniform(10, 30), 1000.0])),
        waves_mm=rng.uniform(0, 0.012),
    )


def _appearance(rng: Rng, plain: BscanAppearance) -> BscanAppearance:
    """Draw the appearance of a device: intraoperative with much speckle, or clinical and averaged."""
    if rng.random() < 0.4:
        return replace(plain, contrast_db=0.0)
    return replace(
        plain,
        signal_db=rng.uniform(-6, 4),
        contrast_db=rng.uniform(-1, 2),
        attenuation_db_per_mm=rng.uniform(0, 8),
        grey_per_db=rng.uniform(4.5, 9.0),
        noise_grey=rng.uniform(5, 60),
        looks=int(np.exp(rng.uniform(np.log(4), np.log(100)))),
        streaks=0,
        columns=0,
        haze_db=-20.0,
        vitreous_db=rng.uniform(-20, 0),
        vessels=int(rng.integers(0, 9)),
        floaters=int(rng.choice([0, int(rng.integers(0, 4))])),
    )


def _detail(rng: Rng, lesions: LesionSettings) -> TissueDetail:
    zone_db = rng.uniform(17, 25)
    rpe_db = zone_db + rng.uniform(-3, 6)
    return TissueDetail(
        lesions=lesions,
        zone_db=zone_db,
        gap_db=zone_db - rng.uniform(0, 8),
        rpe_db=rpe_db,
        membrane_db=rpe_db - rng.uniform(2, 10),
        choroid_db=rpe_db - rng.uniform(-3, 12),
        choroid_mm=rng.uniform(0.06, 0.45),
        choroid_db_per_mm=float(rng.choice([rng.uniform(5, 30), rng.uniform(20, 90)])),
        lumen_db=float(rng.choice([-1, -1, -1, 1])) * rng.uniform(2, 14),
        lumen_mm=rng.uniform(0.03, 0.12),
        sclera_db=rng.uniform(-6, 8),
        fluid_db=rng.uniform(-6, 4),
        drusen_db=rng.uniform(6, 19),
        transmission_db=rng.uniform(2, 10),
        focus_db=rng.uniform(18, 30),
        layer_db=tuple(rng.normal(0, 1.5, len(RETINA_DB) - 1).tolist()),
    )


def _pit_mm(rng: Rng) -> float:
    return float(rng.choice([0.0, rng.uniform(0.05, 0.15)]))


def _lesions(rng: Rng) -> LesionSettings:
    """Draw one to three kinds of lesions."""
    kinds = set(rng.choice(["drusen", "detachment", "fluid", "cysts", "atrophy"], int(rng.integers(1, 4))))

    def among(kind: str, drawn: Any, nothing: Any = 0.0) -> Any:
        return drawn if kind in kinds else nothing

    return LesionSettings(
        drusen=int(among("drusen", rng.integers(2, 20), 0)),
        drusen_mm=rng.uniform(0.03, 0.15),
        detachment_mm=among("detachment", rng.uniform(0.06, 0.35)),
        fluid_mm=among("fluid", rng.uniform(0.03, 0.3)),
        cysts=int(among("cysts", rng.integers(1, 16), 0)),
        cyst_mm=rng.uniform(0.04, 0.25),
        atrophy_mm=among("atrophy", rng.uniform(0.3, 3.5)),
        foci=int(rng.choice([0, int(rng.integers(1, 15))])),
        pit_mm=_pit_mm(rng),
    )


def _mimics(rng: Rng) -> MimicSettings:
    def some(chance: float, most: int) -> int:
        return int(rng.integers(1, most + 1)) if rng.random() < chance else 0

    return MimicSettings(
        ghosts=some(0.25, 2),
        ghost_db=rng.uniform(8, 30),
        membranes=some(0.35, 2),
        walls=some(0.4, 6),
        wall_db=rng.uniform(12, 28),
        lines=some(0.3, 3),
        folded_db=float(rng.uniform(-25, -6)) if rng.random() < 0.12 else -60.0,
        vignette_db=float(rng.uniform(5, 30)) if rng.random() < 0.2 else 0.0,
    )
