"""The file that describes a rig as designed: rig.toml.

The CAD in the top-level folder rig/ builds from it; here it predicts what the camera sees.

Frame: the eye frame [mm]: x right, y up, z towards the camera; the section is z = 0. The camera faces the
section along z, its path folded once by each flat mirror. Unfolded, the camera is at (0, 0, path) and looks
along -z; each mirror exchanges left and right of the image. The top of the image is the eye's top: the camera
is mounted with its top towards where the mirror reflects it, so with turns = "down" it lies on its back below
the mirror, its top towards the eye; with "up" away from the eye; with "left" and "right" it stands upright.
"""

import math
from pathlib import Path
from typing import Annotated, Literal

from msgspec import Meta, Struct, field

from haptigraph.toml_document import Document

__all__ = ["Light", "Mirror", "Rig", "RigCamera", "RigEye", "Tolerances", "load_rig", "parse_rig"]

Positive = Annotated[float, Meta(gt=0, le=1000)]
Angle = Annotated[float, Meta(ge=-90, le=90)]


class RigEye(Struct, frozen=True, forbid_unknown_fields=True):
    """The printed eye, cut open in front of the section. Angles are at its centre, positive to the right."""

    diameter_mm: Annotated[float, Meta(ge=15, le=35)] = 24.0
    """Inner diameter of the globe."""
    wall_mm: Annotated[float, Meta(ge=0.8, le=5)] = 1.8
    cut_mm: Annotated[float, Meta(ge=0, le=5)] = 0.6
    """Distance of the cut face in front of the section."""
    retina_half_deg: Annotated[float, Meta(ge=20, le=90)] = 75.0
    """Extent of the retina shell to either side of the bottom."""
    retina_mm: Annotated[float, Meta(ge=0.6, le=3)] = 1.2
    """Thickness of the exchangeable retina shell; its inner surface lies on the globe."""
    target_deg: Annotated[float, Meta(ge=-60, le=60)] = 9.0
    """Centre of the target, from the bottom, along the retina."""
    target_mm: Annotated[float, Meta(ge=0.5, le=5)] = 1.4
    """Diameter of the target."""
    trocars_deg: tuple[Angle, Angle] = (36.0, -36.0)
    """Ports in the section, from the top; the first is in use."""
    port_mm: Annotated[float, Meta(ge=0.4, le=3)] = 1.2
    """Inner diameter of a port."""


class RigCamera(Struct, frozen=True, forbid_unknown_fields=True):
    """A camera module, from its data sheet."""

    model: str
    source: str
    """Where its numbers are published."""
    width_px: Annotated[int, Meta(ge=64, le=16384)]
    height_px: Annotated[int, Meta(ge=64, le=16384)]
    horizontal_fov_deg: Annotated[float, Meta(gt=1, lt=170)]
    """Of the whole image width."""
    pixel_um: Annotated[float, Meta(gt=0.3, lt=20)]
    f_number: Annotated[float, Meta(gt=0.5, lt=64)]
    focus_mm: Positive
    """Distance of best focus from the entrance pupil."""
    nearest_mm: Annotated[float, Meta(ge=0, le=1000)]
    """Shortest distance at which it works, from its front face."""
    body_mm: tuple[Positive, Positive, Positive]
    """Width, height, depth of its housing."""
    pupil_mm: Annotated[float, Meta(ge=-50, le=100)]
    """Of the entrance pupil behind the front face."""
    pupil_off_mm: tuple[float, float] = (0.0, 0.0)
    """Of the entrance pupil from the centre of the housing: right and up, as seen from behind it."""
    screw: str = "M3"
    screws_mm: tuple[tuple[float, float], ...] = ()
    """Centres of the mounting holes from the centre of the housing, right and up."""
    screws_on: Literal["back", "front", "bottom"] = "back"

    @property
    def focal_px(self) -> float:
        """Focal length in pixels: square pixels, no distortion."""
        return self.width_px / 2 / math.tan(math.radians(self.horizontal_fov_deg) / 2)


class Mirror(Struct, frozen=True, forbid_unknown_fields=True):
    """A flat front-surface mirror at 45 degrees."""

    from_section_mm: Positive
    """From the section to the mirror's centre, along z."""
    to_camera_mm: Positive
    """From the mirror's centre to the camera's front face."""
    size_mm: tuple[Positive, Positive] = (50.0, 50.0)
    """Width, and length along its slope."""
    thickness_mm: Positive = 3.0
    angle_deg: Annotated[float, Meta(ge=30, le=60)] = 45.0
    """Between mirror and section."""
    turns: Literal["up", "down", "left", "right"] = "down"
    """Where the path goes on behind the mirror, in the eye frame's x and y."""


class Light(Struct, frozen=True, forbid_unknown_fields=True):
    """A ring or strip of LEDs around the opening."""

    diameter_mm: Positive = 60.0
    from_section_mm: Positive = 30.0


class Tolerances(Struct, frozen=True, forbid_unknown_fields=True):
    """Standard deviations of what printing and assembly leave open."""

    position_mm: Annotated[float, Meta(gt=0, le=10)] = 0.3
    """Of camera, mirror and eye against each other, per axis."""
    angle_deg: Annotated[float, Meta(gt=0, le=20)] = 0.5
    """Of camera and mirror, per axis."""
    print_mm: Annotated[float, Meta(gt=0, le=2)] = 0.1
    """Of a printed surface."""
    focal_percent: Annotated[float, Meta(gt=0, le=50)] = 1.5
    """Of the camera's focal length against its data sheet."""
    principal_percent: Annotated[float, Meta(gt=0, le=20)] = 0.8
    """Of the principal point from the image's centre, per axis, of the image's width."""


class Rig(Struct, frozen=True, forbid_unknown_fields=True):
    """The contents of rig.toml."""

    format: Literal[1]
    name: str
    camera: RigCamera
    mirrors: tuple[Mirror, ...] = field(name="mirror", default=())
    """None, or one."""
    direct_mm: Positive | None = None
    """Without a mirror: from the section to the camera's front face."""
    eye: RigEye = RigEye()
    light: Light = Light()
    tolerances: Tolerances = Tolerances()

    @property
    def path_mm(self) -> float:
        """From the section to the camera's entrance pupil along the folded path."""
        front_mm = sum(mirror.from_section_mm + mirror.to_camera_mm for mirror in self.mirrors)
        return (self.direct_mm or front_mm) + self.camera.pupil_mm

    @property
    def px_per_mm(self) -> float:
        """Scale of the section in the whole image."""
        return self.camera.focal_px / self.path_mm

    @property
    def mirrored(self) -> bool:
        """Whether the image as stored is left-right mirrored."""
        return len(self.mirrors) % 2 == 1


def load_rig(path: str | Path) -> Rig:
    """Read rig.toml.

    Raises:
        BadInput: If it cannot be read or is not valid.
    """
    return _rig(Document.read(path))


def parse_rig(text: str, file: str) -> Rig:
    """Read it from text; `file` names it in errors.

    Raises:
        BadInput: If it is not valid.
    """
    return _rig(Document(text, file))


def _rig(document: Document) -> Rig:
    rig = document.convert(Rig)
    if len(rig.mirrors) > 1:
        raise document.error(f"{len(rig.mirrors)} mirrors; a rig has one or none", "mirror[1]")
    if bool(rig.mirrors) == (rig.direct_mm is not None):
        raise document.error(
            "a rig has either a [[mirror]] or direct_mm, the distance of a camera that faces the eye",
            "direct_mm",
        )
    return rig
