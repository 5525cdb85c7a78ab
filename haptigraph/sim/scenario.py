"""Scenarios: everything a simulated run depends on, one TOML file each."""

import math
from importlib import resources
from pathlib import Path
from typing import Annotated, ClassVar

from msgspec import Meta, Struct, field
from msgspec.structs import replace

from haptigraph.errors import BadInput, unknown_name
from haptigraph.sim.eye.camera import NeedleShape
from haptigraph.sim.eye.cannula import CannulaShape
from haptigraph.sim.eye.depth import DepthShape
from haptigraph.sim.eye.distractors import Distractors
from haptigraph.sim.eye.eye import EyeShape, RegistrationError
from haptigraph.sim.eye.forceps import ForcepsShape
from haptigraph.sim.eye.membrane import MembraneShape
from haptigraph.sim.eye.optics import CameraSettings
from haptigraph.sim.eye.palette import Appearance
from haptigraph.sim.eye.soft_retina import MAX_DENT_SHARE
from haptigraph.sim.robot.operator import Hand, Move
from haptigraph.sim.robot.readings import ReadingsShape
from haptigraph.sim.robot.robot import RobotLimits
from haptigraph.sim.tissue import TissueShape
from haptigraph.toml_document import Document

__all__ = ["Scenario", "checked_moves", "load_scenario", "scenario_document", "scenario_names"]

BOUNDS = {
    "camera.width_px": (64, 4096),
    "camera.height_px": (64, 4096),
    "camera.center_px": (0, 4096),
    "camera.px_per_mm": (1, 100),
    "camera.tilt_deg": (-30, 30),
    "camera.distance_mm": (30, 1e6),
    "camera.blur_px": (0, 50),
    "camera.shutter_s": (0, 0.2),
    "camera.shake_px": (0, 50),
    "camera.shake_deg": (-360, 360),
    "camera.exposure": (0, 10),
    "camera.vignetting": (0, 1),
    "camera.read_noise_grey": (0, 100),
    "camera.shot_noise_grey": (0, 100),
    "camera.shadow": (0, 1),
    "camera.shadow_shift": (-2, 2),
    "appearance.texture": (0, 10),
    "needle.diameter_mm": (0.01, 3),
    "needle.tip_diameter_mm": (0.01, 3),
    "needle.taper_mm": (0.01, 100),
    "needle.length_mm": (1, 100),
    "needle.brightness": (0, 1),
    "needle.highlight": (0, 1),
}
"""Limits of what can be drawn in reasonable time and memory."""


class About(Struct, frozen=True, forbid_unknown_fields=True):
    """The [scenario] table."""

    OLD_KEYS: ClassVar[dict[str, str]] = {"says": "description"}

    description: str
    """One sentence on what happens."""
    seed: Annotated[int, Meta(ge=0, le=2**32 - 1)] = 0
    rate_hz: Annotated[float, Meta(ge=0.1, le=1000)] = 30.0


class Scenario(Struct, frozen=True, forbid_unknown_fields=True):
    """One scenario of the camera phantom."""

    OLD_KEYS: ClassVar[dict[str, str]] = {"look": "appearance"}

    about: About = field(name="scenario")
    moves: tuple[Move, ...] = field(name="move")
    eye: EyeShape = EyeShape()
    camera: CameraSettings = CameraSettings()
    appearance: Appearance = Appearance()
    needle: NeedleShape = NeedleShape()
    cannula: CannulaShape | None = None
    """The metal tube in the trocar; None: the needle passes through a hole."""
    robot: RobotLimits = RobotLimits()
    readings: ReadingsShape | None = None
    """What the robot reports of itself; None: nothing."""
    operator: Hand = Hand()
    distractors: Distractors = Distractors()
    registration_error: RegistrationError = RegistrationError()
    forceps: ForcepsShape | None = None
    """If given, the instrument is a pair of forceps, with a membrane to peel and a light pipe."""
    membrane: MembraneShape = MembraneShape()
    tissue: TissueShape | None = None
    """How a retina that is a layer deforms; None: it is rigid."""
    depth: DepthShape | None = None
    """The camera's depth images; None: it measures none."""


def scenario_names() -> list[str]:
    """Return the names of the scenarios that ship with haptigraph."""
    files = resources.files("haptigraph.sim").joinpath("scenarios").iterdir()
    return sorted(file.name.removesuffix(".toml") for file in files if file.name.endswith(".toml"))


def scenario_document(name: str) -> Document:
    """Read a scenario by its name, or from a path that ends in .toml, without checking it.

    Raises:
        BadInput: If no scenario has that name.
    """
    if name.endswith(".toml"):
        return Document.read(Path(name))
    if name in scenario_names():
        file = resources.files("haptigraph.sim").joinpath("scenarios").joinpath(f"{name}.toml")
        return Document(file.read_text(encoding="utf-8"), f"scenario {name}")
    raise BadInput(unknown_name("scenario", name, scenario_names()) + ", or the path of a .toml file")


def checked_moves(document: Document, moves: tuple[Move, ...]) -> None:
    """Check the script of a scenario.

    Raises:
        BadInput: If it has no moves, or one that takes no time.
    """
    if not moves:
        raise document.error("no [[move]]; add at least one", "scenario")
    for number, move in enumerate(moves):
        if move.duration_s < 0 or (number == 0 and move.duration_s == 0):
            raise document.error(
                f"duration_s: expected a positive number, found {move.duration_s:g}",
                f"move[{number}].duration_s",
            )


def load_scenario(name: str, target_mm: float | None = None) -> Scenario:
    """Load a scenario by its name, or from a path that ends in .toml.

    Args:
        name: The name or path.
        target_mm: Overrides the target's position: along the retina from its lowest point, positive to the
            surgeon's right.

    Raises:
        BadInput: If no scenario has that name, or the file is not valid.
    """
    document = scenario_document(name)
    if "scan" in document.data:
        raise BadInput(
            "B-scan scenarios are not supported here; play them with `haptigraph run phantom:...` and "
            "--procedure subretinal_injection_ioct",
            document.file,
        )
    scenario = document.convert(Scenario)
    if target_mm is not None:
        target_deg = math.degrees(target_mm / (scenario.eye.diameter_mm / 2))
        scenario = replace(scenario, eye=replace(scenario.eye, target_deg=target_deg))
    checked_moves(document, scenario.moves)
    _check_bounds(document, scenario)
    _check_order(document, "operator", scenario.operator, "tremor_low_hz", "tremor_high_hz")
    _check_order(document, "robot", scenario.robot, "depth_min_mm", "depth_max_mm")
    if scenario.tissue:
        _check_tissue(document, scenario, scenario.tissue)
    return scenario


def _check_bounds(document: Document, scenario: Scenario) -> None:
    for path, (low, high) in BOUNDS.items():
        table, _, key = path.partition(".")
        value = getattr(getattr(scenario, table), key)
        if not all(low <= number <= high for number in (value if isinstance(value, tuple) else (value,))):
            raise document.error(f"{path}: expected {low:g} to {high:g}, found {value}", path)


def _check_order(document: Document, table: str, values: Struct, low: str, high: str) -> None:
    if getattr(values, low) > getattr(values, high):
        problem = f"{low} {getattr(values, low):g} is above {high} {getattr(values, high):g}; swap them"
        raise document.error(problem, f"{table}.{low}")


def _check_tissue(document: Document, scenario: Scenario, tissue: TissueShape) -> None:
    layer_mm = scenario.eye.retina_mm
    if not layer_mm:
        raise document.error(
            "[tissue] needs a retina that is a layer, but eye.retina_mm is 0; set eye.retina_mm to its "
            "thickness, or remove [tissue] for a rigid retina",
            "tissue",
        )
    if scenario.forceps:
        raise document.error(
            "[tissue] cannot be combined with [forceps], whose membrane would not follow; remove one",
            "tissue",
        )
    if tissue.puncture_mm >= MAX_DENT_SHARE * layer_mm:
        raise document.error(
            f"tissue.puncture_mm: expected less than {MAX_DENT_SHARE * layer_mm:g} "
            f"({MAX_DENT_SHARE:g} of eye.retina_mm), found {tissue.puncture_mm:g}",
            "tissue.puncture_mm",
        )
