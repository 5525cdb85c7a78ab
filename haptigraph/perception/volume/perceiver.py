"""The perceiver `volume`: ILM, RPE and needle in a volume, and where the tip will be.

Turns a volume (voxels) into positions (eye frame, mm) with standard deviations. Each volume is processed
independently, except that the tip's motion gives `needle_tip_ahead`.
"""

import numpy as np
from msgspec.structs import replace

from haptigraph.config import PerceptionConfig
from haptigraph.errors import BadInput
from haptigraph.geometry import Geometry, Point, Segment, Surface
from haptigraph.imaging import Floats, Mask
from haptigraph.messages import Capture, Certainty, ImageKind, Observation, Volume
from haptigraph.perception.entities import ENTITIES
from haptigraph.perception.instrument.model import InstrumentModel
from haptigraph.perception.instrument.model_file import load_instrument
from haptigraph.perception.oct.scan_geometry import SUBRETINAL_SHARE
from haptigraph.perception.volume.ahead import AheadSettings, TipAhead, imaged_ns
from haptigraph.perception.volume.learned_needle import find_learned_needle
from haptigraph.perception.volume.scale import VolumeScale
from haptigraph.perception.volume.shaft import (
    FoundNeedle,
    VolumeFindings,
    find_needle_and_surfaces,
    find_surfaces,
)
from haptigraph.perception.volume.surfaces import HeightMap
from haptigraph.registration.oct import ScanRegistration

__all__ = ["VolumePerceiver"]

NS_PER_S = 1e9
MAX_SURFACE_SD_MM = 0.05  # below the tip; a surface less certain is not reported
MAX_NODES = 48  # of a reported surface, along x and z each
BEVEL_MM = 0.1  # length of the segment that shows to which side the bevel opens
SAME_SIZE = 0.01  # relative; voxels that differ by less are of one size
PERIODS_S = (0.01, 1.0)
"""Plausible periods of volumes."""


class VolumePerceiver:
    """Find ILM, RPE and needle.

    Args:
        registration: Size and scale of the volumes, and the depth of the target.
        config: `model` is the file of a learned instrument that is alone in its volumes; empty: any needle
            over a retina.

    Raises:
        BadInput: If the instrument cannot be read, or was learned from other volumes.
    """

    images: ImageKind = "volume"
    entities = ENTITIES["volume"]
    entities_with_sd = frozenset(("needle_tip", "needle_tip_ahead", "needle_line"))

    def __init__(self, registration: ScanRegistration, config: PerceptionConfig) -> None:
        self._registration, slices = registration, registration.image.slices
        if slices is None:
            raise ValueError("expected the registration of volumes")
        self._scale = VolumeScale(
            registration.height_px, slices.count, slices.columns, *registration.voxel_mm
        )
        self._instrument = _instrument(config.model, self._scale) if config.model else None
        self.reset()

    def reset(self) -> None:
        """Forget the tip's motion."""
        self._ahead = TipAhead(AheadSettings())
        self._stamp_ns: int | None = None

    def __call__(self, capture: Capture) -> Observation:
        """Process one volume.

        Raises:
            BadInput: If it is not a volume of the registered size.
        """
        volume = self._registration.checked_volume(capture.image)
        if self._registration.image.mirrored:
            volume = volume[:, :, ::-1]
        findings = self._find(volume)
        found, sd_mm = self._surfaces(findings)
        needle = findings.needle
        certainty = None if needle is None else _certainty(needle)
        if needle is not None:
            found["needle_line"] = _segment(needle.start_mm, needle.end_mm)
            if needle.tip_mm is not None:
                found["needle_tip"] = _point(needle.tip_mm)
                if needle.facing is not None:
                    opening_mm = needle.end_mm + BEVEL_MM * needle.facing
                    found["needle_bevel"] = _segment(needle.end_mm, opening_mm)
        self._predict(capture.stamp_ns, findings, found, sd_mm)
        return Observation(capture.stamp_ns, found, certainty=certainty, sd_mm=sd_mm)

    def _find(self, volume: Volume) -> VolumeFindings:
        if self._instrument is None:
            return find_needle_and_surfaces(volume, self._scale)
        needle = find_learned_needle(volume, self._instrument, self._scale)
        return find_surfaces(volume, self._scale)._replace(needle=needle)

    def _surfaces(
        self, findings: VolumeFindings
    ) -> tuple[dict[str, Geometry], dict[str, float | tuple[float, ...]]]:
        """Return the surfaces that are certain below the tip, and their standard deviations there."""
        ilm, rpe, needle = findings.ilm, findings.rpe, findings.needle
        at_mm = np.zeros(3) if needle is None or needle.tip_mm is None else needle.tip_mm
        sds = {name: _sd_at(surface, at_mm) for name, surface in (("ilm", ilm), ("rpe", rpe))}
        if not ilm.visible.any() or sds["ilm"] > MAX_SURFACE_SD_MM:
            return {}, {}
        found: dict[str, Geometry] = {"ilm": _surface(ilm, ilm.height_mm, ilm.visible)}
        found["retina_surface"] = found["ilm"]
        sd_mm: dict[str, float | tuple[float, ...]] = {}
        sd_mm |= {"ilm": sds["ilm"], "retina_surface": sds["ilm"]}
        if not rpe.visible.any() or sds["rpe"] > MAX_SURFACE_SD_MM:
            return found, sd_mm
        found["rpe"], sd_mm["rpe"] = _surface(rpe, rpe.height_mm, rpe.visible), sds["rpe"]
        shares = ("target_layer", self._registration.target_share), ("subretinal_space", SUBRETINAL_SHARE)
        for name, share in shares:
            height_mm = (1 - share) * ilm.height_mm + share * rpe.height_mm
            found[name] = _surface(ilm, height_mm, ilm.visible & rpe.visible)
            sd_mm[name] = float(np.hypot((1 - share) * sds["ilm"], share * sds["rpe"]))
        return found, sd_mm

    def _predict(
        self,
        stamp_ns: int,
        findings: VolumeFindings,
        found: dict[str, Geometry],
        sd_mm: dict[str, float | tuple[float, ...]],
    ) -> None:
        """Follow the tip's motion, and add where it will be, for a while also if its place is not known."""
        needle, before_ns, self._stamp_ns = findings.needle, self._stamp_ns, stamp_ns
        if before_ns is not None and stamp_ns > before_ns:
            period_s = float(np.clip((stamp_ns - before_ns) / NS_PER_S, *PERIODS_S))
            self._ahead.settings = replace(self._ahead.settings, period_s=period_s)
        tip_mm = None if needle is None else needle.tip_mm
        tip_sd_mm = np.zeros(3) if needle is None else needle.tip_sd_mm
        at_z_mm = 0.0 if tip_mm is None else float(tip_mm[2])
        tip_ns = imaged_ns(stamp_ns, at_z_mm, findings.rpe, self._ahead.settings.period_s)
        rpe = findings.rpe if "rpe" in found else None
        ahead = self._ahead.update(stamp_ns, tip_ns, tip_mm, tip_sd_mm, rpe)
        if ahead is not None and needle is not None:
            found["needle_tip_ahead"], sd_mm["needle_tip_ahead"] = _point(ahead.tip_mm), float(ahead.sd_mm[1])


def _instrument(file: str, scale: VolumeScale) -> InstrumentModel:
    model = load_instrument(file)
    if model.rows != scale.rows or not np.allclose(model.voxel_mm, scale.voxel_mm, rtol=SAME_SIZE):
        learned, given = (
            " x ".join(f"{size:.4g}" for size in each) for each in (model.voxel_mm, scale.voxel_mm)
        )
        raise BadInput(
            f"was learned from volumes of {model.rows} rows and voxels of {learned} mm (rows, slices, "
            f"columns); these have {scale.rows} rows and voxels of {given} mm",
            file,
        )
    return model


def _certainty(needle: FoundNeedle) -> Certainty:
    largest_mm = float(np.sqrt(np.linalg.eigvalsh(needle.tip_cov_mm2)[-1]))
    return Certainty(
        confidence=needle.confidence,
        tip_sd_mm=None if needle.tip_mm is None else largest_mm,
        theta_sd_deg=needle.direction_sd_deg,
    )


def _sd_at(surface: HeightMap, at_mm: Floats) -> float:
    return float(surface.at(np.array(at_mm[0]), np.array(at_mm[2]), surface.sd_mm))


def _point(at_mm: Floats) -> Point:
    x, y, z = at_mm.tolist()
    return Point((x, y), z)


def _segment(start_mm: Floats, end_mm: Floats) -> Segment:
    start, end = start_mm.tolist(), end_mm.tolist()
    return Segment((start[0], start[1]), (end[0], end[1]), start[2], end[2])


def _surface(positions: HeightMap, height_mm: Floats, visible: Mask) -> Surface:
    """Return a surface with at most `MAX_NODES` heights in each direction."""
    rows, columns = (
        np.unique(np.linspace(0, count - 1, min(count, MAX_NODES)).round().astype(np.intp))
        for count in height_mm.shape
    )
    heights, hidden = height_mm[np.ix_(rows, columns)], np.argwhere(~visible[np.ix_(rows, columns)])
    return Surface(
        x_mm=tuple(positions.x_mm[columns].round(6).tolist()),
        z_mm=tuple(positions.z_mm[rows].round(6).tolist()),
        y_mm=tuple(map(tuple, heights.round(6).tolist())),
        interpolated=tuple((row, column) for row, column in hidden.tolist()),
    )
