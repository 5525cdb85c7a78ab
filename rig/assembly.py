"""Rig -> every body of the assembled rig: printed parts, bought parts, screws, each where it is."""

from dataclasses import dataclass

import numpy as np
from build123d import Part

from rig.layout import Layout, Screw
from rig.parts import base, camera_mount, clip, eye, frame, light, mask, mirror_mount, retina, target
from rig.parts.camera_mount import BOARD_MM, CLAMP_MM
from rig.shapes import rod
from rig.standard import HEAD_MM, SLIDE_MM, Print

__all__ = ["Body", "bodies_of", "screws_of"]


@dataclass(frozen=True)
class Body:
    """One body."""

    name: str
    shape: Part
    print: Print | None = None
    """None: bought."""
    group: str = "rig"
    """The actuator clip is an assembly of its own: "clip"."""

    @property
    def kind(self) -> str:
        """Its name without a number: bodies of one kind are the same part."""
        return self.name.rstrip("0123456789").rstrip("_")


def bodies_of(layout: Layout) -> list[Body]:
    """Build every body."""
    bodies = [
        Body("eye", eye.build(layout), eye.PRINT),
        Body("retina", retina.build(layout), retina.PRINT),
        Body("target", target.build(layout), target.PRINT),
        Body("frame", frame.build(layout), frame.PRINT),
        Body("camera_mount", camera_mount.build(layout), camera_mount.print_of(layout)),
        Body("camera", camera_mount.camera(layout)),
        Body("light", light.build(layout), light.PRINT),
        Body("base", base.build(layout), base.PRINT),
    ]
    if not layout.is_board:
        clamp = camera_mount.build_clamp(layout)
        bodies.append(Body("camera_clamp", clamp, camera_mount.print_of_clamp(layout)))
    if layout.mirror:
        bodies += [
            Body("mirror_mount", mirror_mount.build(layout), mirror_mount.PRINT),
            Body("mirror", mirror_mount.mirror(layout)),
            Body("mask", mask.build(layout), mask.PRINT),
            *(Body(f"post_{i + 1}", mask.build_post(layout, i), mask.POST) for i in range(4)),
        ]
    bodies += [Body(f"led_{i + 1}", light.led(*axis)) for i, axis in enumerate(light.led_axes(layout))]
    bodies += [Body(f"screw_{i + 1}", _screw(screw)) for i, screw in enumerate(screws_of(layout))]
    return [
        *bodies,
        Body("clip", clip.build(), clip.PRINT, "clip"),
        Body("motor", clip.motor(), None, "clip"),
        Body("stylus", clip.stylus(), None, "clip"),
    ]


def screws_of(layout: Layout) -> list[Screw]:
    """Return every screw: of the base, the eye and the camera."""
    back, pose = layout.back_mm, layout.camera
    depth = layout.rig.camera.body_mm[2]
    screws = base.screws_of(layout)
    screws += [Screw((x, 0.0, back - 8), (0.0, 0.0, 1.0), 12.0) for x in eye.inserts_mm(layout)]
    behind = tuple(float(side) for side in -pose.look)
    if layout.is_board:
        size = float(layout.rig.camera.screw.removeprefix("M"))
        places = [pose.at(right, up, depth - BOARD_MM) for right, up in layout.rig.camera.screws_mm]
        return screws + [Screw(_point(place), behind, 6.0, size) for place in places]
    places = [pose.at(right, up, -SLIDE_MM - CLAMP_MM) for right, up in camera_mount.corners_mm(layout)]
    return screws + [Screw(_point(place), behind, 8.0) for place in places]


def _screw(screw: Screw) -> Part:
    """Return a screw: its core, as threads cut into what holds them, and its head."""
    start, way, share = np.array(screw.at_mm), np.array(screw.towards), screw.size_mm / 3.0
    core_mm = 2.9 * share if screw.size_mm >= 3 else 0.7 * screw.size_mm
    shank = rod(start, start + screw.length_mm * way, core_mm)
    return shank + rod(start - HEAD_MM[1] * share * way, start, HEAD_MM[0] * share)


def _point(place: np.ndarray) -> tuple[float, float, float]:
    x, y, z = (float(side) for side in place)
    return x, y, z
