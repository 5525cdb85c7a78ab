"""The OCT phantom: play a needle's approach to a retina B-scan by B-scan, with the ground truth.

It plays scenarios that have a [scan] table; those that also have a [volume] table are played by
`volume_phantom`. The needle moves along one straight line, with the scripted
minimum-jerk moves and hand tremor of the camera phantom: `depth_mm` is measured from the line's intersection
with the resting ILM, and `theta_deg` is added to `lean_deg`.
"""

import math
import sys
from typing import Annotated, ClassVar

import numpy as np
from msgspec import Meta, Struct, field
from msgspec.structs import replace

from haptigraph.errors import BadInput
from haptigraph.geometry import Geometry, Polyline, Vec
from haptigraph.messages import Truth
from haptigraph.registration.text import scan_registration_text
from haptigraph.sim.oct.appearance import BscanAppearance
from haptigraph.sim.oct.bscan import BscanCamera, ScanSettings
from haptigraph.sim.oct.needle import BscanNeedle
from haptigraph.sim.oct.retina import Retina, RetinaShape, Surfaces
from haptigraph.sim.oct.volumes.phantom import VolumePhantom, load_volume_scenario
from haptigraph.sim.phantom import BLANK, Moment, Phantom
from haptigraph.sim.robot.operator import Hand, Move, ScriptedOperator
from haptigraph.sim.scenario import About, checked_moves, load_scenario, scenario_document
from haptigraph.toml_document import Document

__all__ = ["Approach", "ScanPhantom", "ScanScenario", "load_scan_scenario", "open_phantom"]

TRUTH_EVERY = 8  # columns between two reported points of the true surfaces


class Approach(Struct, frozen=True, forbid_unknown_fields=True):
    """The [approach] table: the line that the needle moves on, and its target."""

    lean_deg: Annotated[float, Meta(ge=10, le=170)] = 35.0
    """Angle of the shaft to the horizontal; above 90 the needle comes from the right."""
    aim_mm: Annotated[float, Meta(ge=-4, le=4)] = 0.0
    """Intersection of the line with the resting ILM, from the centre of the image to the right."""
    depth_share: Annotated[float, Meta(gt=0, lt=1)] = 0.6
    """Depth of the target, as a share of the distance from ILM to RPE."""
    motion_scale: Annotated[float, Meta(ge=0, le=10)] = 0.2
    """Tool motion over hand motion; scales the tremor."""


class ScanScenario(Struct, frozen=True, forbid_unknown_fields=True):
    """One B-scan scenario."""

    OLD_KEYS: ClassVar[dict[str, str]] = {"look": "appearance"}

    about: About = field(name="scenario")
    scan: ScanSettings
    moves: tuple[Move, ...] = field(name="move")
    approach: Approach = Approach()
    retina: RetinaShape = RetinaShape()
    appearance: BscanAppearance = BscanAppearance()
    needle: BscanNeedle = BscanNeedle()
    operator: Hand = Hand()


def load_scan_scenario(document: Document) -> ScanScenario:
    """Convert and check a B-scan scenario.

    Raises:
        BadInput: If the file is not valid.
    """
    scenario = document.convert(ScanScenario)
    checked_moves(document, scenario.moves)
    return scenario


def open_phantom(name: str, target_mm: float | None = None) -> "Phantom | ScanPhantom | VolumePhantom":
    """Open the phantom of a scenario of any kind, ready for its first image.

    Raises:
        BadInput: If no scenario has that name, the file is not valid, or the target cannot be moved.
    """
    document = scenario_document(name)
    if "scan" not in document.data:
        return Phantom(load_scenario(name, target_mm)).paint()
    if target_mm is not None:
        raise BadInput("source.target_mm does not apply to B-scan scenarios; set approach.depth_share", name)
    if "volume" in document.data:
        return VolumePhantom(load_volume_scenario(document))
    return ScanPhantom(load_scan_scenario(document))


class ScanPhantom:
    """Play a B-scan scenario.

    Args:
        scenario: The scenario.
    """

    def __init__(self, scenario: ScanScenario) -> None:
        self.scenario = scenario
        seed = scenario.about.seed
        self.camera = BscanCamera(scenario.scan, scenario.appearance, scenario.needle, seed)
        self._retina = Retina(scenario.retina, self.camera.x_mm, seed)
        approach = scenario.approach
        self._script = ScriptedOperator(scenario.moves, scenario.operator, approach.motion_scale, seed, 0.0)
        self.images = max(1, min(round(self._script.duration_s * scenario.about.rate_hz), sys.maxsize))
        """Number of images in one run."""
        self._aim_mm = approach.aim_mm, self._retina.rest_mm(approach.aim_mm)
        self.registration = _registration_text(scenario)
        self.robot_setup = self.depth_camera = None
        """Registration given to perception: the scale and the depth of the target."""
        self.restart()

    def restart(self) -> None:
        """Return to the start of the scenario."""
        self._next = 0
        self._retina.restart()

    def advance(self, *, draws: bool = True) -> Moment | None:
        """Advance by one image; return None once the operator is done.

        Args:
            draws: Whether to draw the image; otherwise it is one black pixel.
        """
        if self._next >= self.images:
            return None
        number, self._next = self._next, self._next + 1
        elapsed_s = 1 / self.scenario.about.rate_hz
        time_s = number * elapsed_s
        tip_mm, direction = self._needle(time_s)
        visible_tip_mm = None if self._script.is_away(time_s) else tip_mm
        surfaces = self._retina.advance(time_s, elapsed_s if number else 0.0, visible_tip_mm)
        image = self.camera.render(surfaces, visible_tip_mm, direction, number).image if draws else BLANK
        truth = self._truth(surfaces, tip_mm, direction)
        if visible_tip_mm is None:
            truth = replace(truth, visible=False, inside=False)
        return Moment(time_s, image, truth)

    def _needle(self, time_s: float) -> tuple[Vec, Vec]:
        """Return tip and direction, eye frame."""
        depth_mm, theta_deg = self._script.pose_at(time_s)
        along_mm, across_mm = self._script.tremor_at(time_s)
        turn = math.radians(self.scenario.approach.lean_deg + theta_deg)
        dx, dy = math.cos(turn), -math.sin(turn)
        depth_mm += along_mm
        x, y = self._aim_mm
        return (x + depth_mm * dx - across_mm * dy, y + depth_mm * dy + across_mm * dx), (dx, dy)

    def _truth(self, surfaces: Surfaces, tip_mm: Vec, direction: Vec) -> Truth:
        x_mm, settings = self.camera.x_mm, self.scenario.scan
        ilm_mm = float(np.interp(tip_mm[0], x_mm, surfaces.ilm_mm))
        tip_px = self.camera.geometry.to_px(tip_mm)
        others: dict[str, Geometry] = {
            name: Polyline(tuple(zip(x_mm[::TRUTH_EVERY].tolist(), row[::TRUTH_EVERY].tolist(), strict=True)))
            for name, row in (("ilm", surfaces.ilm_mm), ("rpe", surfaces.rpe_mm))
        }
        return Truth(
            visible=0 <= tip_px[0] < settings.width_px and 0 <= tip_px[1] < settings.height_px,
            inside=surfaces.is_pierced,
            tip_px=tip_px,
            tip_mm=tip_mm,
            depth_mm=ilm_mm - tip_mm[1],
            theta_deg=math.degrees(math.atan2(-direction[1], abs(direction[0]))),
            others=others,
        )


def _registration_text(scenario: ScanScenario) -> str:
    scan = scenario.scan
    return scan_registration_text(
        (scan.width_px, scan.height_px),
        scan.axial_mm_per_px,
        scan.lateral_mm_per_px,
        "Registration of simulated B-scans.",
        scenario.approach.depth_share,
    )
