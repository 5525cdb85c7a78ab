"""Random B-scans for evaluation and training, each with its own retina, needle, appearance and artefacts.

A scene holds all parameters of a B-scan, drawn from a number and a seed.
"""

import math
from typing import Any

import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from haptigraph.sim.oct.appearance import BscanAppearance
from haptigraph.sim.oct.bscan import Bscan, BscanCamera, ScanSettings
from haptigraph.sim.oct.layers import TissueDetail
from haptigraph.sim.oct.mimics import MimicSettings
from haptigraph.sim.oct.needle import BscanNeedle
from haptigraph.sim.oct.retina import Retina, RetinaShape

__all__ = ["PLACES", "BscanScene", "random_bscan", "random_scene"]

PLACES = ("above", "touching", "inside", "none")
"""Positions of the tip relative to the retina; "none": there is no needle."""
SETTLE_S = 3.0  # after which a dent no longer creeps

Rng = np.random.Generator


class BscanScene(Struct, frozen=True):
    """The parameters of one random B-scan."""

    scan: ScanSettings
    retina: RetinaShape
    appearance: BscanAppearance
    needle: BscanNeedle
    place: str
    """One of `PLACES`."""
    tip_x_mm: float
    tip_depth_mm: float
    """Below the resting ILM at `tip_x_mm`; negative above."""
    angle_deg: float
    """Angle of the shaft to the horizontal, in millimetres; above 90 it comes from the right."""
    seed: int
    detail: TissueDetail | None = None
    """Outer retina, lesions and choroid; None: a plain retina."""
    mimics: MimicSettings | None = None

    def camera(self) -> BscanCamera:
        """Return the camera of the scene."""
        return BscanCamera(
            self.scan, self.appearance, self.needle, self.seed, detail=self.detail, mimics=self.mimics
        )

    def take(self, camera: BscanCamera | None = None, number: int = 0) -> Bscan:
        """Render the B-scan; `number` chooses the speckle."""
        camera = camera or self.camera()
        retina = Retina(self.retina, camera.x_mm, self.seed)
        if self.place == "none":
            return camera.render(retina.advance(0.0, 0.0, None), None, number=number)
        height_mm = retina.rest_mm(self.tip_x_mm) + retina.motion_mm(0.0) - self.tip_depth_mm
        tip_mm = self.tip_x_mm, height_mm
        surfaces = retina.advance(0.0, SETTLE_S, tip_mm)
        angle = math.radians(self.angle_deg)
        if camera.tissue:  # the retina is healthy; lesions raise its surface and the tip with it
            raised_mm = np.interp(self.tip_x_mm, camera.x_mm, camera.tissue.profiles.ilm_raised_mm())
            tip_mm = self.tip_x_mm, height_mm + float(raised_mm)
        return camera.render(surfaces, tip_mm, (math.cos(angle), -math.sin(angle)), number)


def random_bscan(number: int, seed: int = 0, *, size_px: tuple[int, int] = (512, 512)) -> Bscan:
    """Draw a random B-scan with its ground truth; the same number and seed give the same image."""
    return random_scene(number, seed, size_px=size_px).take()


def random_scene(
    number: int, seed: int = 0, *, size_px: tuple[int, int] = (512, 512), place: str = "", **fixed: Any
) -> BscanScene:
    """Draw the parameters of a random B-scan.

    Args:
        number: Number of the scene.
        seed: Seed of all scenes.
        size_px: (width, height) of the image.
        place: Position of the tip, one of `PLACES`; empty: it cycles with the number.
        fixed: Fields of `BscanScene`, and of its appearance, retina and needle, that are set and not drawn.

    Raises:
        TypeError: If there is no such field.
    """
    rng = np.random.default_rng((seed, 25, number))
    scan = _scan(rng, size_px)
    retina = _retina(rng, scan)
    place = place or PLACES[(0, 0, 1, 2, 2, 3)[number % 6]]
    depth_mm = {
        "above": -rng.uniform(0.03, 0.5),
        "touching": rng.uniform(0.0, retina.puncture_mm),
        "inside": retina.puncture_mm + rng.uniform(0.02, 0.9) * retina.thickness_mm,
    }.get(place, 0.0)
    lean_deg = rng.uniform(25, 50)
    scene = BscanScene(
        scan=scan,
        retina=retina,
        appearance=_appearance(rng),
        needle=_needle(rng),
        place=place,
        tip_x_mm=rng.uniform(-0.3, 0.3) * scan.width_px * scan.lateral_mm_per_px,
        tip_depth_mm=depth_mm,
        angle_deg=lean_deg if rng.random() < 0.5 else 180 - lean_deg,
        seed=int(rng.integers(2**31)),
    )
    return _with(scene, fixed)


def _with(scene: BscanScene, fixed: dict[str, Any]) -> BscanScene:
    """Return a scene with some of its fields, or its parts' fields, set."""
    for name, value in fixed.items():
        owner = next(
            (part for part in ("appearance", "retina", "needle") if hasattr(getattr(scene, part), name)), None
        )
        if owner is not None:
            scene = replace(scene, **{owner: replace(getattr(scene, owner), **{name: value})})
        else:
            scene = replace(scene, **{name: value})
    return scene


def _scan(rng: Rng, size_px: tuple[int, int]) -> ScanSettings:
    width, height = size_px
    return ScanSettings(
        width_px=width,
        height_px=height,
        axial_mm_per_px=rng.uniform(1.4, 2.0) / height,
        lateral_mm_per_px=rng.uniform(2.5, 5.0) / width,
    )


def _retina(rng: Rng, scan: ScanSettings) -> RetinaShape:
    return RetinaShape(
        height_mm=rng.uniform(-0.25, 0.1) * scan.height_px * scan.axial_mm_per_px,
        thickness_mm=rng.uniform(0.2, 0.38),
        tilt_deg=rng.uniform(-8, 8),
        radius_mm=rng.uniform(10, 20),
        waves_mm=rng.uniform(0, 0.012),
        dent_mm=rng.uniform(0.25, 0.8),
        puncture_mm=rng.uniform(0.02, 0.12),
        drag_share=rng.uniform(0.1, 0.5),
        rpe_share=rng.uniform(0.2, 0.6),
    )


def _appearance(rng: Rng) -> BscanAppearance:
    def sometimes(chance: float, usual: Any, drawn: Any) -> Any:
        return drawn if rng.random() < chance else usual

    return BscanAppearance(
        signal_db=rng.uniform(-5, 3),
        contrast_db=rng.uniform(-1.5, 3),
        attenuation_db_per_mm=rng.uniform(2, 14),
        vitreous_db=rng.uniform(-10, 2),
        grey_per_db=rng.uniform(4.5, 6.5),
        noise_grey=rng.uniform(40, 75),
        lateral_grain_px=rng.uniform(0.5, 1.5),
        axial_grain_px=rng.uniform(0.4, 1.0),
        looks=int(sometimes(0.3, 1, int(rng.integers(2, 6)))),
        vessels=int(rng.integers(0, 5)),
        vessel_db=rng.uniform(3, 14),
        streaks=int(sometimes(0.4, 0, int(rng.integers(1, 5)))),
        columns=int(sometimes(0.2, 0, int(rng.integers(1, 4)))),
        haze_db=float(sometimes(0.3, -20.0, rng.uniform(2, 9))),
        haze_mm=rng.uniform(0.08, 0.25),
        floaters=int(rng.integers(0, 7)),
    )


def _needle(rng: Rng) -> BscanNeedle:
    return BscanNeedle(
        width_px=rng.uniform(3.5, 8),
        bright_db=rng.uniform(22, 34),
        tissue_loss_db=rng.uniform(8, 22),
        bevel_px=float(rng.choice([0.0, rng.uniform(5, 50)])),
        gap_db=rng.uniform(5, 20),
        edge_px=rng.uniform(1.5, 6),
        ghost_db=float(rng.uniform(6, 15) if rng.random() < 0.25 else 60.0),
    )
