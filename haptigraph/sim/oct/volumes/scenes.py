"""Random volumes for evaluation, each with its own retina, needle, appearance and artefacts."""

import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from haptigraph.sim.oct.appearance import BscanAppearance
from haptigraph.sim.oct.bscan import ScanSettings
from haptigraph.sim.oct.retina import RetinaShape
from haptigraph.sim.oct.scenes import PLACES, SETTLE_S
from haptigraph.sim.oct.volumes.acquisition import Acquisition
from haptigraph.sim.oct.volumes.needle import NeedlePose, VolumeNeedle, pose
from haptigraph.sim.oct.volumes.volume import Volume, VolumeCamera, VolumeSettings

__all__ = ["VOLUME_SHAPE", "VolumeScene", "random_volume_scene"]

VOLUME_SHAPE = 256, 48, 192
"""Axial rows, slices, lateral columns."""
LEAN_DEG = 25.0, 42.0
BELOW_RPE_MM = 0.25  # least depth of the volume below the resting RPE

Rng = np.random.Generator


class VolumeScene(Struct, frozen=True):
    """The parameters of one random volume."""

    scan: ScanSettings
    volume: VolumeSettings
    retina: RetinaShape
    appearance: BscanAppearance
    needle: VolumeNeedle
    place: str
    """Position of the tip relative to the retina, one of `scenes.PLACES`."""
    tip_x_mm: float
    tip_z_mm: float
    tip_depth_mm: float
    """Below the resting ILM; negative above."""
    lean_deg: float
    """Angle of the needle below the horizontal."""
    turn_deg: float
    """Direction of the needle in the plane of x and z: 0 to the right, 90 to the viewer."""
    seed: int

    def acquisition(self) -> Acquisition:
        """Return what acquires the scene's volumes."""
        return Acquisition(self.scan, self.volume, self.retina, self.needle, self.seed)

    def camera(self) -> VolumeCamera:
        """Return the camera of the scene."""
        return VolumeCamera(self.scan, self.volume, self.appearance, self.needle, self.seed)

    def pose(self, acquisition: Acquisition) -> NeedlePose | None:
        """Return the needle's pose; None if there is none."""
        if self.place == "none":
            return None
        retina = acquisition.retina
        rest_mm = float(retina.rest_mm(np.array(self.tip_x_mm), np.array(self.tip_z_mm)).ilm_mm)
        height_mm = rest_mm + retina.motion_mm(0.0) - self.tip_depth_mm
        tip_mm = np.array([self.tip_x_mm, height_mm, self.tip_z_mm])
        return pose(tip_mm, self.lean_deg, self.turn_deg, self.needle.roll_deg)

    def take(self, number: int = 0) -> Volume:
        """Render the volume, of a needle that does not move; `number` chooses the speckle."""
        acquisition = self.acquisition()
        needle = self.pose(acquisition)
        truth = acquisition.advance(0.0, SETTLE_S, 0.0, lambda _: needle, number)
        return Volume(self.camera().render(truth, number), truth)


def random_volume_scene(
    number: int, seed: int = 0, *, shape: tuple[int, int, int] = VOLUME_SHAPE, place: str = ""
) -> VolumeScene:
    """Draw the parameters of a random volume; the same number and seed give the same scene.

    Args:
        number: Number of the scene.
        seed: Seed of all scenes.
        shape: Axial rows, slices and lateral columns.
        place: Position of the tip, one of `scenes.PLACES`; empty: it cycles with the number.
    """
    rng = np.random.default_rng((seed, 30, number))
    height, slices, width = shape
    scan = ScanSettings(
        width_px=width,
        height_px=height,
        axial_mm_per_px=rng.uniform(1.5, 2.0) / height,
        lateral_mm_per_px=rng.uniform(1.6, 2.4) / width,
    )
    volume = VolumeSettings(
        slices=slices,
        slice_mm=rng.uniform(1.6, 2.2) / slices,
        tilt_deg=rng.uniform(-6, 6),
        jitter_mm=rng.uniform(0, 0.005),
    )
    retina = _retina(rng, scan)
    place = place or PLACES[(0, 0, 1, 2, 2, 3)[number % 6]]
    depth_mm = {
        "above": -rng.uniform(0.03, 0.4),
        "touching": rng.uniform(0.0, retina.puncture_mm),
        "inside": retina.puncture_mm + rng.uniform(0.02, 0.8) * retina.thickness_mm,
    }.get(place, 0.0)
    return VolumeScene(
        scan=scan,
        volume=volume,
        retina=retina,
        appearance=_appearance(rng),
        needle=_needle(rng),
        place=place,
        tip_x_mm=rng.uniform(-0.25, 0.25) * width * scan.lateral_mm_per_px,
        tip_z_mm=rng.uniform(-0.25, 0.25) * slices * volume.slice_mm,
        tip_depth_mm=depth_mm,
        lean_deg=rng.uniform(*LEAN_DEG),
        turn_deg=rng.uniform(0, 360),
        seed=int(rng.integers(2**31)),
    )


def _retina(rng: Rng, scan: ScanSettings) -> RetinaShape:
    retina = RetinaShape(
        height_mm=rng.uniform(-0.2, 0.05) * scan.height_px * scan.axial_mm_per_px,
        thickness_mm=rng.uniform(0.22, 0.36),
        tilt_deg=rng.uniform(-6, 6),
        radius_mm=rng.uniform(10, 20),
        waves_mm=rng.uniform(0, 0.01),
        dent_mm=rng.uniform(0.25, 0.8),
        puncture_mm=rng.uniform(0.02, 0.12),
        drag_share=rng.uniform(0.1, 0.5),
        rpe_share=rng.uniform(0.2, 0.6),
        breathing_mm=rng.uniform(0, 0.08),
        breathing_hz=rng.uniform(0.15, 0.35),
        heartbeat_mm=rng.uniform(0, 0.02),
        heartbeat_hz=rng.uniform(0.8, 1.6),
    )
    lowest_mm = -scan.height_px * scan.axial_mm_per_px / 2 + BELOW_RPE_MM + retina.thickness_mm
    return replace(retina, height_mm=max(retina.height_mm, lowest_mm + retina.breathing_mm))


def _appearance(rng: Rng) -> BscanAppearance:
    return BscanAppearance(
        signal_db=rng.uniform(-4, 3),
        contrast_db=rng.uniform(-1.5, 3),
        attenuation_db_per_mm=rng.uniform(2, 12),
        vitreous_db=rng.uniform(-10, 2),
        grey_per_db=rng.uniform(4.5, 6.5),
        noise_grey=rng.uniform(40, 75),
        lateral_grain_px=rng.uniform(0.4, 0.9),
        axial_grain_px=rng.uniform(0.4, 0.8),
        vessels=int(rng.integers(0, 6)),
        vessel_db=rng.uniform(3, 12),
        streaks=int(rng.integers(0, 4) if rng.random() < 0.4 else 0),
        haze_db=float(rng.uniform(2, 8) if rng.random() < 0.3 else -20.0),
        haze_mm=rng.uniform(0.08, 0.25),
        floaters=int(rng.integers(0, 3)),
    )


def _needle(rng: Rng) -> VolumeNeedle:
    return VolumeNeedle(
        diameter_mm=rng.uniform(0.09, 0.13),
        bevel_deg=rng.uniform(20, 32),
        roll_deg=float(180 * rng.integers(2) + rng.uniform(-20, 20)),
        bright_db=rng.uniform(24, 34),
        ridge_mm=rng.uniform(0.012, 0.025),
        tissue_loss_db=rng.uniform(8, 20),
        gap_db=rng.uniform(3, 14),
        beam_mm=rng.uniform(0.005, 0.011),
    )
