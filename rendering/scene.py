"""Scenes to render: all parameters of a rendering, one TOML file each in `scenes/`.

Angles about the globe's centre are from the bottom, positive to the surgeon's right; colours are linear RGB.
"""

import sys
from pathlib import Path
from typing import Annotated, Literal

from msgspec import Meta, Struct, field

from haptigraph.errors import BadInput, unknown_name
from haptigraph.toml_document import Document

__all__ = [
    "Bowl",
    "Camera",
    "Color",
    "Instrument",
    "Light",
    "Needle",
    "Scene",
    "load_scene",
    "output_folder",
    "scene_file",
    "scene_from_arguments",
    "scene_names",
]

FOLDER = Path(__file__).parent / "scenes"
OUTPUT = Path(__file__).parent.parent / "build" / "renderings"

Share = Annotated[float, Meta(ge=0, le=1)]
Color = tuple[Share, Share, Share]
Bearing = Annotated[float, Meta(ge=-75, le=75)]
Offset = Annotated[float, Meta(ge=-8, le=8)]
Width = Annotated[float, Meta(ge=0.1, le=1)]


class Camera(Struct, frozen=True, forbid_unknown_fields=True):
    """The [camera] table."""

    px_per_mm: Annotated[float, Meta(ge=5, le=25)]
    globe_mm: tuple[Offset, Offset]
    """The globe's centre, right of the image centre and above it."""
    filter_px: Annotated[float, Meta(ge=0.5, le=10)] = 1.5
    """Width of the pixel filter."""
    exposure_stops: Annotated[float, Meta(ge=-5, le=5)] = 0.0


class Bowl(Struct, frozen=True, forbid_unknown_fields=True):
    """The [bowl] table: the opened eye."""

    color: Color
    rim_color: Color
    """Of the cut and of the outside."""
    lower_color: Color | None = None
    """Of the bottom, if it differs."""
    mottle: Annotated[float, Meta(ge=0, le=0.5)] = 0.06
    """Relative variation of the colour."""
    vessels: bool = False


class Needle(Struct, frozen=True, forbid_unknown_fields=True):
    """The [needle] table."""

    point: Literal["bevel", "blunt", "cone", "round"]
    width_mm: Width
    taper_mm: Annotated[float, Meta(ge=0.5, le=20)] | None = None
    """Length of the cone."""
    roll_deg: Annotated[float, Meta(ge=-180, le=180)] | None = None
    """Rotation of a bevel about the shaft: at 0 its tip is beside the axis, at 90 behind it."""
    color: Color = (0.6, 0.6, 0.6)
    roughness: Share = 0.35
    is_metal: bool = True


class Instrument(Struct, frozen=True, forbid_unknown_fields=True):
    """The [second_instrument] table: with a round end, stationary in the other trocar."""

    width_mm: Width
    aim_deg: Bearing
    """The point on the retina it points at."""
    depth_mm: Annotated[float, Meta(ge=0, le=24)]
    """From the trocar to its end."""
    color: Color = (0.5, 0.5, 0.5)
    roughness: Share = 0.4
    is_metal: bool = True


class Light(Struct, frozen=True, forbid_unknown_fields=True):
    """A [[light]]: a square area light at 150 mm."""

    towards: tuple[float, float, float]
    """Its direction from the globe: right, away from the camera, up."""
    size_mm: Annotated[float, Meta(ge=1, le=500)]
    strength: Annotated[float, Meta(ge=0, le=10)] = 1.0


class Scene(Struct, frozen=True, forbid_unknown_fields=True):
    """One scene."""

    description: str = field(name="says")
    """The scene in one line."""
    seed: Annotated[int, Meta(ge=0, le=2**32 - 1)]
    """Of the sensor noise and of the positions of surroundings and beads."""
    trocar: Literal["first", "second"]
    """The one the needle passes: first is on the right, second on the left."""
    target_deg: Bearing
    start_deg: Annotated[float, Meta(ge=-15, le=15)]
    """Angle from the line trocar -> target at entry, counter-clockwise."""
    camera: Camera
    bowl: Bowl
    needle: Needle
    lights: tuple[Light, ...] = field(name="light")
    second_instrument: Instrument | None = None
    beads: Annotated[int, Meta(ge=0, le=20)] = 0
    """Number of beads in the bowl."""
    rod_color: Color = (0.1, 0.25, 0.6)
    """Of the rod behind the eye."""
    ambient: Annotated[float, Meta(ge=0, le=10)] = 0.35
    """Strength of the ambient light."""


def scene_names() -> list[str]:
    """Return the names of all scenes."""
    return sorted(path.stem for path in FOLDER.glob("*.toml"))


def scene_file(name: str) -> Path:
    """Return the file of a scene.

    Raises:
        BadInput: If the name is unknown.
    """
    if name not in scene_names():
        raise BadInput(unknown_name("scene", name, scene_names()))
    return FOLDER / f"{name}.toml"


def output_folder(name: str) -> Path:
    """Return the folder of a scene's clip."""
    return OUTPUT / name


def load_scene(path: Path) -> Scene:
    """Read a scene.

    Raises:
        BadInput: With file, line, what was found and what would be valid, if it is not valid.
    """
    document = Document.read(path)
    scene = document.convert(Scene)
    if not scene.lights:
        raise document.error("light: found none; the scene needs at least one [[light]]", "light")
    for number, light in enumerate(scene.lights):
        if not any(light.towards):
            problem = "expected a direction [right, away, up], found [0, 0, 0]"
            raise document.error(f"light[{number}].towards: {problem}", f"light[{number}].towards")
    for key, point in (("taper_mm", "cone"), ("roll_deg", "bevel")):
        _check_goes_with(document, scene.needle, key, point)
    return scene


def _check_goes_with(document: Document, needle: Needle, key: str, point: str) -> None:
    """Check that a key is given if and only if the needle has the point it describes."""
    is_given = getattr(needle, key) is not None
    if needle.point == point and not is_given:
        raise document.error(f"needle: key {key!r} is missing; point {point!r} needs it", "needle.point")
    if needle.point != point and is_given:
        problem = f"goes with point {point!r} only, found point {needle.point!r}"
        raise document.error(f"needle.{key}: {problem}", f"needle.{key}")


def scene_from_arguments(arguments: list[str]) -> tuple[str, Scene]:
    """Return the name and scene given on the command line; exit with code 2 and a message if not valid."""
    try:
        if len(arguments) != 1:
            raise BadInput(f"expected the name of one scene, found {len(arguments)}")
        return arguments[0], load_scene(scene_file(arguments[0]))
    except BadInput as error:
        print(f"rendering: {error}", file=sys.stderr)
        raise SystemExit(2) from None
