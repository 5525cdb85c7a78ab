"""The phantom of volumes: play a needle's approach to a retina volume by volume, with the ground truth.

It plays scenarios that have a [volume] table beside [scan]. The needle moves along one straight line, with
the scripted minimum-jerk moves and hand tremor of the camera phantom: `depth_mm` is measured from the line's
intersection with the resting ILM, and `theta_deg` is added to `lean_deg`. A volume is complete at its time;
its slices were acquired one after the other since the volume before.
"""

import math
import sys
from typing import Annotated

import numpy as np
from msgspec import Meta, Struct, field

from haptigraph.geometry import Geometry, Polyline
from haptigraph.messages import Truth
from haptigraph.registration.text import scan_registration_text
from haptigraph.sim.oct.appearance import BscanAppearance
from haptigraph.sim.oct.bscan import ScanSettings
from haptigraph.sim.oct.retina import RetinaShape
from haptigraph.sim.oct.volumes.acquisition import Acquisition
from haptigraph.sim.oct.volumes.needle import NeedlePose, VolumeNeedle, pose
from haptigraph.sim.oct.volumes.volume import VolumeCamera, VolumeSettings, VolumeTruth
from haptigraph.sim.phantom import BLANK, Moment
from haptigraph.sim.robot.operator import Hand, Move, ScriptedOperator
from haptigraph.sim.scenario import About, checked_moves
from haptigraph.toml_document import Document

__all__ = ["VolumeApproach", "VolumePhantom", "VolumeScenario", "load_volume_scenario"]

TRUTH_EVERY = 8  # columns between two reported points of the true surfaces
NOWHERE = np.array([0.0, 100.0, 0.0])


class VolumeApproach(Struct, frozen=True, forbid_unknown_fields=True):
    """The [approach] table: the line that the needle moves on, and its target."""

    lean_deg: Annotated[float, Meta(ge=10, le=80)] = 35.0
    """Angle of the needle below the horizontal."""
    turn_deg: Annotated[float, Meta(ge=-360, le=360)] = 20.0
    """Direction of the needle in the plane of x and z: 0 to the right, 90 to the viewer."""
    aim_x_mm: Annotated[float, Meta(ge=-4, le=4)] = 0.0
    """Intersection of the line with the resting ILM, from the volume's centre to the right."""
    aim_z_mm: Annotated[float, Meta(ge=-4, le=4)] = 0.0
    """The same, towards the viewer."""
    depth_share: Annotated[float, Meta(gt=0, lt=1)] = 0.6
    """Depth of the target, as a share of the distance from ILM to RPE."""
    motion_scale: Annotated[float, Meta(ge=0, le=10)] = 0.2
    """Tool motion over hand motion; scales the tremor."""


class VolumeScenario(Struct, frozen=True, forbid_unknown_fields=True):
    """One volume scenario."""

    about: About = field(name="scenario")
    scan: ScanSettings
    volume: VolumeSettings
    moves: tuple[Move, ...] = field(name="move")
    approach: VolumeApproach = VolumeApproach()
    retina: RetinaShape = RetinaShape()
    appearance: BscanAppearance = BscanAppearance()
    needle: VolumeNeedle = VolumeNeedle()
    operator: Hand = Hand()


def load_volume_scenario(document: Document) -> VolumeScenario:
    """Convert and check a volume scenario.

    Raises:
        BadInput: If the file is not valid.
    """
    scenario = document.convert(VolumeScenario)
    checked_moves(document, scenario.moves)
    return scenario


class VolumePhantom:
    """Play a volume scenario.

    Args:
        scenario: The scenario.
    """

    def __init__(self, scenario: VolumeScenario) -> None:
        self.scenario = scenario
        seed = scenario.about.seed
        self._acquisition = Acquisition(
            scenario.scan, scenario.volume, scenario.retina, scenario.needle, seed
        )
        self.camera = VolumeCamera(scenario.scan, scenario.volume, scenario.appearance, scenario.needle, seed)
        approach = scenario.approach
        self._script = ScriptedOperator(scenario.moves, scenario.operator, approach.motion_scale, seed, 0.0)
        self.images = max(1, min(round(self._script.duration_s * scenario.about.rate_hz), sys.maxsize))
        """Number of volumes in one run."""
        aim_mm = np.array(approach.aim_x_mm), np.array(approach.aim_z_mm)
        rest = self._acquisition.retina.rest_mm(*aim_mm)
        self._aim_mm = np.array([approach.aim_x_mm, float(rest.ilm_mm), approach.aim_z_mm])
        self.registration = _registration_text(scenario)
        self.robot_setup = self.depth_camera = None
        """Registration given to perception: the scale, the slices and the depth of the target."""
        self.restart()

    def restart(self) -> None:
        """Return to the start of the scenario."""
        self._next = 0
        self._acquisition.restart()
        self.truth: VolumeTruth | None = None
        """Ground truth of the last volume in 3D; None before the first."""

    def advance(self, *, draws: bool = True) -> Moment | None:
        """Advance by one volume; return None once the operator is done.

        Args:
            draws: Whether to draw the volume, (h, n * w); otherwise it is one black pixel.
        """
        if self._next >= self.images:
            return None
        number, self._next = self._next, self._next + 1
        period_s = 1 / self.scenario.about.rate_hz
        time_s = number * period_s
        truth = self._acquisition.advance(
            time_s, period_s if number else 0.0, period_s, self._pose_at, number
        )
        self.truth = truth
        image = self.camera.render(truth, number) if draws else BLANK
        return Moment(time_s, image, self._truth(truth))

    def _pose_at(self, time_s: float) -> NeedlePose | None:
        """Return the needle's pose, eye frame; None while it is out of view."""
        time_s = max(time_s, 0.0)
        if self._script.is_away(time_s):
            return None
        approach = self.scenario.approach
        depth_mm, theta_deg = self._script.pose_at(time_s)
        along_mm, across_mm = self._script.tremor_at(time_s)
        needle = pose(
            self._aim_mm, approach.lean_deg + theta_deg, approach.turn_deg, self.scenario.needle.roll_deg
        )
        upper = np.cross(np.cross(needle.along, (0.0, 1.0, 0.0)), needle.along)
        upper /= np.linalg.norm(upper)
        return needle.moved((depth_mm + along_mm) * needle.along + across_mm * upper)

    def _truth(self, truth: VolumeTruth) -> Truth:
        """Return the ground truth in the plane of the slice that contains the tip; x and y, eye frame."""
        grid, needle = truth.grid, truth.needle
        tip_mm = NOWHERE if needle is None else needle.tip_mm
        row, at, column = grid.index(tip_mm)
        number = min(max(round(at), 0), grid.shape[1] - 1)
        others: dict[str, Geometry] = {
            name: Polyline(
                tuple(zip(grid.x_mm[::TRUTH_EVERY].tolist(), rows[::TRUTH_EVERY].tolist(), strict=True))
            )
            for name, rows in (("ilm", truth.ilm_mm[number]), ("rpe", truth.rpe_mm[number]))
        }
        lean = 0.0 if needle is None else math.degrees(math.asin(-float(needle.along[1])))
        return Truth(
            visible=grid.contains(tip_mm),
            inside=truth.is_pierced,
            tip_px=(number * grid.shape[2] + column, row),
            tip_mm=(float(tip_mm[0]), float(tip_mm[1])),
            depth_mm=truth.tip_ilm_mm - float(tip_mm[1]),
            theta_deg=lean,
            others=others,
        )


def _registration_text(scenario: VolumeScenario) -> str:
    scan, volume = scenario.scan, scenario.volume
    text = scan_registration_text(
        (scan.width_px, scan.height_px),
        scan.axial_mm_per_px,
        scan.lateral_mm_per_px,
        "Registration of simulated volumes.",
        scenario.approach.depth_share,
    )
    return f"{text}\n[volume]\nslices = {volume.slices}\nslice_mm = {volume.slice_mm:.9g}\n"
